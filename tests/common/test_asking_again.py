"""Retries of a busy service, at its own pace and up to a limit."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import httpx
import pytest

from tigas_common.asking_again import asked_again

pytestmark = pytest.mark.anyio


@pytest.fixture
def slept(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The pauses that were made."""
    pauses: list[float] = []

    async def sleep(seconds: float) -> None:
        pauses.append(seconds)

    monkeypatch.setattr("tigas_common.asking_again.asyncio.sleep", sleep)
    return pauses


def answering(*answers: httpx.Response) -> Callable[[], Awaitable[httpx.Response]]:
    left = iter(answers)

    async def ask() -> httpx.Response:
        return next(left)

    return ask


def busy(status: int = 503, **headers: str) -> httpx.Response:
    return httpx.Response(status, headers={name.replace("_", "-"): value for name, value in headers.items()})


async def test_it_waits_as_long_as_the_service_says_within_reason(slept: list[float]) -> None:
    ask = answering(busy(retry_after="3"), busy(429, retry_after="600"), busy(409), busy(retry_after="soon"), busy(200))
    assert (await asked_again(ask)).status_code == 200
    assert slept == [3, 10, 1, 1]


async def test_what_stays_busy_has_the_last_word(slept: list[float]) -> None:
    assert (await asked_again(answering(*[busy()] * 5))).status_code == 503
    assert len(slept) == 4


async def test_other_refusals_are_final(slept: list[float]) -> None:
    assert (await asked_again(answering(busy(404)))).status_code == 404
    assert slept == []
