"""Connection limits, for all services alike."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from contextlib import AsyncExitStack
from datetime import UTC, datetime

import pytest
from starlette.responses import Response

from tests.common.raw_client import ASK, PATIENCE_S, connected
from tigas_common.address import Address
from tigas_common.certificate import Certificate
from tigas_common.http_limits import HttpLimits
from tigas_common.runner import serve_http

pytestmark = pytest.mark.anyio
HERE = Address("127.0.0.1", 0)
LONG_S = 60


def server_tls() -> ssl.SSLContext:
    """With a generated certificate."""
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    Certificate.create(["localhost"], datetime.now(UTC)).load_into(tls)
    return tls


def client_tls() -> ssl.SSLContext:
    """Trusts every certificate."""
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
    return tls


async def test_all_addresses_together_have_a_limit_and_a_place_that_is_left_is_free() -> None:
    limits = HttpLimits(connections=3, header_s=LONG_S)
    async with serve_http(Response("ok"), HERE, limits) as port, AsyncExitStack() as stack:
        first, *_ = [await stack.enter_async_context(connected(port, f"127.0.0.{number}")) for number in (2, 3, 4)]
        async with connected(port, "127.0.0.5") as refused:
            answer = await refused.answer()
            assert (answer.status, answer.problem) == (503, "tigas:too-many-connections")
            assert await refused.ended() == b""
        first.say(ASK.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
        assert (await first.answer()).status == 200
        await first.ended()
        async with connected(port, "127.0.0.5") as admitted:
            admitted.say(ASK)
            assert (await admitted.answer()).status == 200


async def test_a_tls_handshake_takes_a_place_and_not_for_ever() -> None:
    limits = HttpLimits(connections_per_address=2, header_s=1)
    async with serve_http(Response("ok"), HERE, limits, server_tls()) as port, AsyncExitStack() as stack:
        silent = [await stack.enter_async_context(connected(port)) for _ in range(2)]
        async with connected(port) as refused:
            assert await refused.ended() == b""
        assert [await client.ended() for client in silent] == [b"", b""]
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=client_tls())
        writer.write(ASK)
        assert b" 200 OK" in await reader.readline()
        writer.close()
        await writer.wait_closed()


async def test_a_client_that_does_not_end_tls_keeps_no_connection() -> None:
    async with serve_http(Response("ok"), HERE, HttpLimits(header_s=0.5), server_tls()) as port:

        def answer_nothing() -> None:
            plain = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
            with client_tls().wrap_socket(plain) as client, contextlib.suppress(ConnectionResetError):
                while plain_read(client):
                    pass

        await asyncio.to_thread(answer_nothing)


def plain_read(client: ssl.SSLSocket) -> bytes:
    """Received bytes below TLS, which would answer the server's close."""
    return socket.socket.recv(client, 4096)
