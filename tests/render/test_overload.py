"""Overload: simulated, with a virtual clock and remote viewers."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import pytest

from tests.render.fakes import FakeScenes, FakeUse, render_request
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.engine.frame_size import FrameSize
from tigas_render.engine.work import Work
from tigas_render.engine.work_queue import WorkQueue
from tigas_render.frame import Client

FRAME_S = 0.002
"""That a frame takes the only thread."""
FRAMES_PER_S = 30
"""That each viewer asks for."""
SECONDS = 4.0
WAY_S = 0.05
"""Between a viewer and the server."""
GOLDEN = 0.618034


@dataclass
class World:
    """Viewers that cancel requests overtaken by a newer frame."""

    viewers: int
    now: float = 0.0
    rendered: int = 0
    ages: list[float] = field(default_factory=list)
    """Response times in seconds of frames that were the newest on arrival."""

    def __post_init__(self) -> None:
        self._queue = WorkQueue(2, DEFAULT_LADDER, lambda: self.now, lambda work, why: None)
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = itertools.count()
        self._asked: dict[Client, list[Work]] = {}
        self._is_busy = False

    def run(self) -> World:
        for viewer, seq in itertools.product(range(self.viewers), range(int(FRAMES_PER_S * SECONDS))):
            client = Client(f"address {viewer}", "session")
            self._at((seq + viewer * GOLDEN % 1) / FRAMES_PER_S, partial(self._arrives, client, seq))
        while self._events:
            self.now, _, happens = heapq.heappop(self._events)
            happens()
        return self

    def _at(self, when: float, happens: Callable[[], None]) -> None:
        heapq.heappush(self._events, (when, next(self._numbers), happens))

    def _arrives(self, client: Client, seq: int) -> None:
        use = FakeUse(FakeScenes(), "scene")
        work = Work(client, render_request(seq=seq), self.now, use, lambda answer: None)
        work.size = FrameSize.of(work.request, DEFAULT_LADDER)
        self._asked.setdefault(client, []).append(work)
        self._queue.push(work)
        self._render()

    def _render(self) -> None:
        if self._is_busy or not self._queue:
            return
        work = self._queue.next()
        assert work is not None
        self._is_busy = True
        self._at(self.now + FRAME_S, partial(self._made, work))

    def _made(self, work: Work) -> None:
        self._is_busy = False
        self._queue.rendered()
        self._queue.done(work, FRAME_S, is_whole=True)
        self.rendered += 1
        self._at(self.now + WAY_S, partial(self._comes, work))
        self._render()

    def _comes(self, work: Work) -> None:
        asked = self._asked[work.client]
        if work in asked:
            older = asked[: asked.index(work) + 1]
            del asked[: len(older)]
            self.ages.append(self.now - work.arrived + WAY_S)
            self._at(self.now + WAY_S, partial(self._cancelled, older))

    def _cancelled(self, older: list[Work]) -> None:
        for work in older:
            self._queue.remove(work)


def p95_ms(ages: list[float]) -> float:
    return 1000 * sorted(ages)[len(ages) * 95 // 100]


@pytest.mark.parametrize("viewers", [14, 18, 25, 34])
def test_all_that_is_rendered_is_shown_and_none_of_it_is_old(viewers: int) -> None:
    world = World(viewers).run()
    assert len(world.ages) == world.rendered
    assert world.rendered >= 0.99 * SECONDS * min(1 / FRAME_S, FRAMES_PER_S * viewers)
    assert p95_ms(world.ages) < 1000 * (2 * WAY_S + FRAME_S * viewers)


def test_just_above_what_can_be_rendered_viewers_get_more_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    with_ = len(World(18).run().ages)
    monkeypatch.setattr(Work, "overtakes", lambda *_: False)
    assert with_ > 1.05 * len(World(18).run().ages)
    assert math.isclose(World(14).run().rendered, FRAMES_PER_S * SECONDS * 14)
