"""How long an application waits for a request's body."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest
from starlette.requests import Request
from starlette.types import Message

from tigas_common import web
from tigas_common.errors import BodyTooLarge, RequestTimeout
from tigas_common.web import read_body

pytestmark = pytest.mark.anyio
TIMEOUT_S = 0.5


@pytest.fixture(autouse=True)
def short_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "BODY_S", TIMEOUT_S)


def request(parts: AsyncIterator[bytes]) -> Request:
    """A request with a body in these parts."""

    async def receive() -> Message:
        part = await anext(parts, None)
        return {"type": "http.request", "body": part or b"", "more_body": part is not None}

    return Request({"type": "http", "method": "POST", "headers": []}, receive)


async def every(seconds: float, count: int, size: int) -> AsyncIterator[bytes]:
    for _ in range(count):
        await asyncio.sleep(seconds)
        yield bytes(size)


async def test_a_slow_body_is_waited_for_as_long_as_it_comes() -> None:
    parts, apart = 10, TIMEOUT_S / 5
    assert parts * apart > TIMEOUT_S
    assert len(await read_body(request(every(apart, parts, 1000)), 100_000)) == parts * 1000


@pytest.mark.parametrize("apart", [60.0, 0.02], ids=["silence", "trickle"])
async def test_silence_and_a_trickle_are_given_up(apart: float) -> None:
    async with asyncio.timeout(20):
        with pytest.raises(RequestTimeout, match="did not arrive in time"):
            await read_body(request(every(apart, 10_000, 1)), 100_000)


async def test_no_more_is_read_than_the_limit() -> None:
    with pytest.raises(BodyTooLarge):
        await read_body(request(every(0, 10_000, 1000)), 2000)
