"""A stopping service answers the requests that it cannot finish."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

import pytest
from starlette.types import Receive, Scope, Send

from tests.common.raw_client import ASK, connected
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.runner import serve_http

pytestmark = pytest.mark.anyio


async def test_a_request_that_is_cut_when_the_service_stops_is_answered_503() -> None:
    began = asyncio.Event()

    async def endless(scope: Scope, receive: Receive, send: Send) -> None:
        began.set()
        await asyncio.Event().wait()

    async with AsyncExitStack() as service:
        port = await service.enter_async_context(serve_http(endless, Address("127.0.0.1", 0), HttpLimits()))
        async with connected(port) as client:
            client.say(ASK)
            await began.wait()
            await service.aclose()
            answer = await client.answer()
    assert (answer.status, answer.problem) == (503, "tigas:overloaded")
