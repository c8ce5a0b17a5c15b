"""Answers that are handed on."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import httpx
import pytest
from starlette.types import Message

from tigas_common.proxy import run_until, stream_response

pytestmark = pytest.mark.anyio


class Endless(httpx.AsyncByteStream):
    closed = False

    async def __aiter__(self) -> AsyncIterator[bytes]:
        while True:
            await asyncio.sleep(0)
            yield b"more"

    async def aclose(self) -> None:
        self.closed = True


async def test_what_nobody_takes_any_more_is_not_fetched() -> None:
    body, left, parts = Endless(), asyncio.Event(), 0

    async def receive() -> Message:
        await left.wait()
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        nonlocal parts
        parts += message["type"] == "http.response.body"
        if parts == 5:
            left.set()

    async with asyncio.timeout(30):
        await stream_response(httpx.Response(200, stream=body), [], receive, send)
    assert parts < 10
    assert body.closed


async def test_work_and_its_end_cancel_each_other_but_a_future_is_left_alone() -> None:
    cancelled: list[str] = []

    async def endless(name: str) -> str:
        try:
            await asyncio.Event().wait()
        finally:
            cancelled.append(name)
        return "never"

    async def work() -> str:
        await asyncio.sleep(0)
        return "done"

    gone: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    assert await run_until(gone, work()) == "done"
    assert not gone.done()
    assert await run_until(endless("end"), work()) == "done"
    asyncio.get_running_loop().call_soon(gone.set_result, None)
    await run_until(gone, endless("work"))
    await asyncio.sleep(0)
    assert cancelled == ["end", "work"]


async def test_an_answer_that_comes_as_its_client_leaves_is_closed() -> None:
    never: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def is_closed_or_used(turns: int) -> bool:
        """Whether nobody has to close the body, which comes so many turns of the event loop after the departure."""
        body, left = Endless(), asyncio.Event()

        async def ask() -> httpx.Response:
            left.set()
            for _ in range(turns):
                await asyncio.sleep(0)
            return httpx.Response(200, stream=body)

        used = await run_until(left.wait(), run_until(never, ask())) is not None
        await asyncio.sleep(0)
        return used or body.closed

    assert [await is_closed_or_used(turns) for turns in (0, 1)] == [True, True]
