"""Who may connect, where services differ in nothing."""

from __future__ import annotations

import asyncio
import ssl
from contextlib import AsyncExitStack
from datetime import UTC, datetime

import pytest
from starlette.responses import Response

from tests.common.raw_client import ASK, connected
from tigas_common.address import Address
from tigas_common.certificate import Certificate
from tigas_common.http_limits import HttpLimits
from tigas_common.runner import serve_http

pytestmark = pytest.mark.anyio
HERE = Address("127.0.0.1", 0)
LONG_S = 60


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
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    Certificate.create(["localhost"], datetime.now(UTC)).load_into(tls)
    limits = HttpLimits(connections_per_address=2, header_s=1)
    async with serve_http(Response("ok"), HERE, limits, tls) as port, AsyncExitStack() as stack:
        silent = [await stack.enter_async_context(connected(port)) for _ in range(2)]
        async with connected(port) as refused:
            assert await refused.ended() == b""
        assert [await client.ended() for client in silent] == [b"", b""]
        trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=trusting)
        writer.write(ASK)
        assert b" 200 OK" in await reader.readline()
        writer.close()
        await writer.wait_closed()
