"""One address's HTTP requests take no more than its share of the event loop."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

import httpx
import pytest
from starlette.types import ASGIApp, Receive, Scope, Send

from tigas_common.loop_share import BURST_S, MAX_WAIT_S, LoopShare
from tigas_common.origins import OriginPolicy

pytestmark = pytest.mark.anyio
GREEDY, POLITE = "192.0.2.1", "192.0.2.2"
SHARE = 0.2


class Clock:
    """A clock that advances only when a request works or waits."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    async def sleep(self, seconds: float) -> None:
        self.now += seconds


Ask = Callable[..., Coroutine[Any, Any, httpx.Response]]


@pytest.fixture
def clock() -> Clock:
    return Clock()


def working(clock: Clock, seconds: float, status: int = 200) -> ASGIApp:
    """An application that keeps the loop busy for this long."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        clock.now += seconds
        await send({"type": "http.response.start", "status": status, "headers": []})
        await send({"type": "http.response.body", "body": b"done"})

    return app


def asking(app: ASGIApp, clock: Clock) -> Ask:
    """Asks an application that gives each address its share."""
    limited = LoopShare(app, SHARE, OriginPolicy(), clock, clock, clock.sleep)

    async def ask(address: str, path: str = "/metrics") -> httpx.Response:
        transport = httpx.ASGITransport(limited, client=(address, 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.get(path)

    return ask


async def test_an_address_gets_its_share_and_no_more(clock: Clock) -> None:
    ask = asking(working(clock, cost := 0.008), clock)
    began, asked = clock.now, 1000
    for _ in range(asked):
        assert (await ask(GREEDY)).status_code == 200
    assert asked * cost / (clock.now - began) == pytest.approx(SHARE, rel=0.1)


async def test_an_address_over_its_share_is_refused_and_another_is_served(clock: Clock) -> None:
    ask = asking(working(clock, 2.0), clock)
    assert (await ask(GREEDY)).status_code == 200
    began = clock.now
    refused = await ask(GREEDY)
    assert clock.now - began == pytest.approx(MAX_WAIT_S), "a request repeated at once is held back"
    assert refused.status_code == 429
    assert 1 <= int(refused.headers["retry-after"]) <= 2.0 / SHARE
    assert refused.headers["content-type"] == "application/problem+json"
    assert refused.json()["type"] == "tigas:asked-too-often"
    began = clock.now
    polite = await ask(POLITE)
    assert (polite.status_code, polite.content) == (200, b"done")
    assert clock.now - began == pytest.approx(2.0)


async def test_a_refused_address_is_served_after_the_time_that_it_was_told(clock: Clock) -> None:
    ask = asking(working(clock, 2.0), clock)
    await ask(GREEDY)
    clock.now += int((await ask(GREEDY)).headers["retry-after"])
    assert (await ask(GREEDY)).status_code == 200


async def test_a_page_that_is_opened_does_not_wait(clock: Clock) -> None:
    ask = asking(working(clock, cost := 0.001), clock)
    for _ in range(int(BURST_S / cost / 2)):
        began = clock.now
        await ask(POLITE)
        assert clock.now - began == pytest.approx(cost)


async def test_frames_are_not_counted_but_failed_requests_for_them_are(clock: Clock) -> None:
    good = asking(working(clock, 2.0), clock)
    for _ in range(3):
        assert (await good(GREEDY, "/render")).status_code == 200
    bad = asking(working(clock, 2.0, 400), clock)
    assert [(await bad(GREEDY, "/render")).status_code for _ in range(2)] == [400, 429]


async def test_a_request_that_fails_is_counted(clock: Clock) -> None:
    async def failing(scope: Scope, receive: Receive, send: Send) -> None:
        clock.now += 2.0
        raise RuntimeError

    ask = asking(failing, clock)
    with pytest.raises(RuntimeError):
        await ask(GREEDY)
    assert (await ask(GREEDY)).status_code == 429
