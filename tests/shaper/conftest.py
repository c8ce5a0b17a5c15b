"""A link that only records, and a time that tests advance."""

from __future__ import annotations

import asyncio
import heapq
import itertools

import pytest

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.link.link import Counters, LinkClosed
from tigas_shaper.player import Player
from tigas_shaper.traces.trace import NetworkTrace

IDLE = LinkSetting(100_000, 50_000)


class FakeTime:
    """A clock, and sleeps that end when it has been advanced past them."""

    def __init__(self) -> None:
        self.now = 0.0
        self._sleepers: list[tuple[float, int, asyncio.Future[None]]] = []
        self._order = itertools.count()

    def clock(self) -> float:
        return self.now

    async def sleep(self, seconds: float) -> None:
        wake: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._sleepers, (self.now + seconds, next(self._order), wake))
        await wake

    async def advance(self, seconds: float) -> None:
        """Let time pass, waking each sleeper at its own moment."""
        end = self.now + seconds
        await _settle()
        while self._sleepers and self._sleepers[0][0] <= end:
            self.now, _, wake = heapq.heappop(self._sleepers)
            if not wake.done():
                wake.set_result(None)
            await _settle()
        self.now = end


async def _settle() -> None:
    for _ in range(5):
        await asyncio.sleep(0)


class FakeLink:
    backend = "relay"

    def __init__(self, time: FakeTime) -> None:
        self.closed_reason: str | None = None
        self.applied: list[tuple[float, float]] = []
        """Time (s) and rate towards the client of each change."""
        self.states: list[LinkSetting] = []
        self.queues: list[tuple[float, float]] = []
        self.sent = 0
        self._time = time

    def apply(self, state: LinkSetting, mean_kbps: tuple[float, float] | None = None) -> None:
        self._check()
        if mean_kbps is not None:
            self.queues.append(mean_kbps)
        self.applied.append((round(self._time.now, 6), state.down_kbps))
        self.states.append(state)

    async def counters(self) -> tuple[Counters, Counters]:
        self._check()
        self.sent += 25_000
        return Counters(self.sent, 3, 12_500), Counters(0, 0, 0)

    def close(self, reason: str) -> None:
        self.closed_reason = reason

    def _check(self) -> None:
        if self.closed_reason:
            raise LinkClosed(self.closed_reason)


class FakeGateway:
    async def check(self) -> None:
        pass


def make_player(time: FakeTime, link: FakeLink) -> Player:
    return Player(link, IDLE, clock=time.clock, sleep=time.sleep)


def trace(*down: float, step_ms: int = 100, name: str = "made") -> NetworkTrace:
    states = tuple(LinkSetting(rate, 1_000) for rate in down)
    return NetworkTrace(name, tuple(range(0, step_ms * len(down), step_ms)), states, step_ms * len(down))


@pytest.fixture
def time() -> FakeTime:
    return FakeTime()


@pytest.fixture
def link(time: FakeTime) -> FakeLink:
    return FakeLink(time)
