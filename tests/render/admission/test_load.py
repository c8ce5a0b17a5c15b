"""When a server takes new viewers, and when it does not, with a clock that the test turns."""

from __future__ import annotations

import random
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import pytest

from tigas_render.admission import load as load_module
from tigas_render.admission.load import (
    ALWAYS_ADMITTED,
    FREE_AT,
    FULL_AT,
    MAX_AGE_S,
    MIN_RATE,
    SETTLED_S,
    STANDING_AGE_S,
    TICK_S,
    Load,
    busy_time,
)


class Loop:
    """An event loop with a given load."""

    def __init__(self, viewers: int = 10) -> None:
        self.now = self.cpu = 0.0
        self.load = Load(lambda: self.now, lambda: self.cpu)
        for _ in range(viewers):
            self.load.add_viewer()

    def run(self, seconds: float, busy: float, ages: tuple[float, ...] = ()) -> None:
        """Seconds with datagrams of these ages in each tick."""
        for _ in range(round(seconds / TICK_S)):
            for age in ages:
                self.load.accept_datagram(age)
            self.pause(TICK_S, busy)

    def pause(self, seconds: float, busy: float) -> None:
        """The loop is blocked for this long."""
        self.now += seconds
        self.cpu += busy * seconds
        self.load.tick()

    @property
    def is_full(self) -> bool:
        return self.load.retry_after_s() is not None


QUICK, LATE = (0.001,) * 10, (0.02,) * 10
BETWEEN = (FREE_AT + FULL_AT) / 2


@pytest.mark.parametrize(
    "steps",
    [
        [(10, FULL_AT - 0.05, QUICK, False), (5, FULL_AT + 0.1, QUICK, True), (1, 0.1, (), True), (5, 0.1, (), False)],
        [(5, 1.0, QUICK, True), (5, FULL_AT, QUICK, True), *[(0.3, BETWEEN + by, (), True) for by in (-0.1, 0.1)] * 50],
        [(1, 0.2, LATE, True)],
        [*[(0.2, 0.2, LATE, None), (0.1, 0.2, QUICK, None)] * 20, (0.1, 0.2, QUICK, True)],
        [(0.2, 0.2, (0.1, 0.08, 0.04, 0.02, 0.002), False), (0.3, 0.2, QUICK, False)] * 10,
    ],
    ids=["hot, then cool for a while", "about the limit: no flapping", "late", "mostly late", "bursts"],
)
def test_whether_a_loop_is_full_after(steps: list[tuple[float, float, tuple[float, ...], bool | None]]) -> None:
    """steps: seconds, utilisation, ages of datagrams, and whether it is full then."""
    loop = Loop()
    for seconds, busy, ages, is_full in steps:
        loop.run(seconds, busy, ages)
        assert is_full is None or loop.is_full == is_full


@pytest.mark.parametrize("busy", [0.0, 1.0])
@pytest.mark.parametrize("seconds", [0.2, 1.0, 30.0])
def test_one_pause_refuses_nobody(seconds: float, busy: float) -> None:
    loop = Loop()
    loop.run(5, busy=0.05, ages=QUICK)
    for age in (0.0, seconds / 2, seconds):  # arrived in the meantime
        loop.load.accept_datagram(age)
    loop.pause(seconds, busy)
    for _ in range(20):
        assert not loop.is_full
        loop.run(TICK_S, busy=0.05, ages=QUICK)
    assert loop.load.requests_per_s is None


def test_a_slow_renderer_takes_no_more_clients_only_while_it_has_no_pause() -> None:
    loop = Loop()
    for utilisation, is_full in ((0.5, False), (1.0, True)):
        loop.load.record_engine(0.2, utilisation)
        loop.run(5, busy=0.1)
        assert loop.is_full == is_full


def test_a_rush_is_let_in_a_few_at_a_time_until_it_is_known_what_they_cost() -> None:
    loop = Loop(viewers=0)
    while not loop.is_full:
        loop.load.add_viewer()
    assert 10 < loop.load.viewers < 40
    loop.run(SETTLED_S + TICK_S, busy=0.01 * loop.load.viewers)
    assert not loop.is_full


def test_a_thousand_who_ask_for_nothing_come_in_within_seconds() -> None:
    loop = Loop(viewers=0)
    while loop.load.viewers < 1000:
        while loop.load.viewers < 1000 and not loop.is_full:
            loop.load.add_viewer()
        loop.run(TICK_S, busy=0.02)
    assert loop.now < 15


def test_those_who_are_in_are_slowed_down_until_it_is_better_and_nobody_new_is_taken_meanwhile() -> None:
    loop = Loop()
    rates = [loop.load.requests_per_s]
    for seconds, busy, ages in ((5, 1.0, LATE), (60, 1.0, LATE), (5, 0.3, QUICK)):
        loop.run(seconds, busy, ages)
        assert loop.is_full
        rates.append(loop.load.requests_per_s)
    assert rates[0] is None
    assert [rate is not None and MIN_RATE <= rate < 30 for rate in rates[1:]] == [True] * 3
    assert rates[2] == MIN_RATE < (rates[3] or 0)
    loop.run(60, busy=0.3, ages=QUICK)
    assert loop.load.requests_per_s is None
    assert not loop.is_full


def test_old_datagrams_are_dropped_and_sooner_where_a_queue_stands() -> None:
    loop = Loop()
    for limit, ages in ((MAX_AGE_S, ()), (STANDING_AGE_S, LATE)):
        loop.run(1, busy=1.0, ages=ages)
        assert loop.load.accept_datagram(0.9 * limit)
        assert not loop.load.accept_datagram(1.1 * limit)
    assert loop.load.state.stale == 2


def test_a_few_are_always_taken_and_as_fast_as_they_like() -> None:
    loop = Loop(viewers=2)
    loop.run(10, busy=1.0, ages=LATE)
    assert not loop.is_full
    assert loop.load.requests_per_s is None
    for _ in range(ALWAYS_ADMITTED - 1):
        loop.load.add_viewer()
    assert loop.is_full
    assert loop.load.requests_per_s is not None


@dataclass
class Viewer:
    """Sends requests 30 times per second, or at the announced rate; returns some time after a refusal."""

    next_at: float
    is_in: bool = False


def simulated(viewers: int, seconds: float = 40.0, then_s: float = 0.002) -> tuple[float, float]:
    """Frames a second and the 95th percentile of latency in seconds, of a loop that serves requests in order.

    Each takes 2 ms, and from a quarter of the time on `then_s`. The first half is not counted.
    """
    rng = random.Random(1)
    now = cpu = 0.0
    load = Load(lambda: now, lambda: cpu)
    queue: deque[float] = deque()
    everybody = [Viewer(rng.uniform(0, 1)) for _ in range(viewers)]
    latencies, tick_at = [], TICK_S
    while now < seconds:
        for viewer in everybody:
            while viewer.next_at <= now:
                if not viewer.is_in and (retry_after := load.retry_after_s()) is not None:
                    viewer.next_at += retry_after * rng.uniform(1, 1.5)
                    continue
                if not viewer.is_in:
                    viewer.is_in = True
                    load.add_viewer()
                queue.append(viewer.next_at)
                viewer.next_at += rng.uniform(0.5, 1.5) / min(30.0, load.requests_per_s or 30.0)
        if queue:
            arrived = queue.popleft()
            cost_s = 0.002 if now < seconds / 4 else then_s
            if load.accept_datagram(now - arrived):
                now, cpu = now + cost_s, cpu + cost_s
                if now > seconds / 2:
                    latencies.append(now - arrived)
        else:
            now = min(tick_at, min(viewer.next_at for viewer in everybody))
        if now >= tick_at:
            load.tick()
            tick_at = now + TICK_S
    return len(latencies) / (seconds / 2), sorted(latencies)[int(0.95 * len(latencies))]


def test_at_twice_what_it_can_serve_those_who_are_in_hardly_wait_and_nothing_is_lost() -> None:
    peak = max(simulated(viewers)[0] for viewers in (12, 14, 16, 18))
    assert peak > 400  # of 500
    for viewers in (33, 50, 160):
        frames_per_s, p95 = simulated(viewers)
        assert frames_per_s > 0.9 * peak
        assert p95 < 0.05


def test_a_machine_that_gets_three_times_as_slow_slows_its_viewers_down() -> None:
    frames_per_s, p95 = simulated(15, then_s=0.006)
    assert frames_per_s > 100  # of 167
    assert p95 < 0.1


def test_it_says_how_old_things_got() -> None:
    loop = Loop()
    loop.load.accept_datagram(0.2)
    loop.load.record_engine(queue_age_s=0.03, utilisation=0.4)
    loop.pause(0.5, busy=0.0)
    assert loop.load.state.ages == pytest.approx({"datagrams": 0.2, "loop": 0.4, "engine": 0.03})
    loop.run(5, busy=0.0)
    assert loop.load.state.ages["datagrams"] == 0.0


def test_computing_counts_as_busy_and_sleeping_does_not() -> None:
    before, computed = busy_time(), time.thread_time()
    while time.thread_time() < computed + 0.05:
        pass
    between = busy_time()
    assert between - before >= 0.045
    time.sleep(0.3)
    assert busy_time() - between < 0.25


def test_waiting_for_a_processor_counts_where_the_kernel_tells_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load_module, "SCHEDSTAT", tmp_path / "schedstat")
    assert busy_time() == pytest.approx(time.thread_time(), abs=0.1)
    (tmp_path / "schedstat").write_text("2000000000 3500000000 17\n")
    assert busy_time() == 5.5
