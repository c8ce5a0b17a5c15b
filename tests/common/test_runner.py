"""What every service gets from the server that runs it."""

from __future__ import annotations

import asyncio
import socket
import time

import psutil
import pytest
from starlette.responses import Response

from tigas_common.address import Address
from tigas_common.runner import serve_http

pytestmark = pytest.mark.anyio
PATIENCE_S = 20


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="only Linux cuts such readers off")
async def test_a_client_that_reads_nothing_loses_its_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tigas_common.address.UNREAD_TIMEOUT_S", 1)
    more_than_the_system_buffers = Response(bytes(20_000_000))
    async with serve_http(more_than_the_system_buffers, Address("127.0.0.1", 0)) as port:
        with socket.create_connection(("127.0.0.1", port)) as stuck:
            stuck.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")

            def connected() -> bool:
                return any(one.raddr == stuck.getsockname() for one in psutil.Process().net_connections("tcp"))

            deadline = time.monotonic() + PATIENCE_S
            for wanted in (True, False):
                while connected() != wanted:
                    assert time.monotonic() < deadline
                    await asyncio.sleep(0.05)
