"""The capacity, found in few tries, and the comparison of services, with made-up steps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest

from benchmarks.load.measure import Capacity, Subject, Timing, compare, measure_capacity, search
from benchmarks.load.report import comparison_lines, verdict
from benchmarks.load.step import Generator, ServerUse, Step

GOOD = Step(
    1, 0, 300, {"served": 300}, 10, (9, 11), 20, (19, 21), 30, (29, 31), 5.5, 23, Generator(0.1, 0.5, 1),
    ServerUse(1.0, 210.0, 42),
)  # fmt: skip
TIMING = Timing(5, 1)


class Made:
    """A service with a given capacity, and viewers' processes with another."""

    def __init__(self, capacity: int, generator: int = 1000, p95_ms: float = 20) -> None:
        self.capacity, self.generator, self.p95_ms = capacity, generator, p95_ms
        self.crowds = self

    def clear(self) -> None:
        """Zero viewers."""

    def step(self, viewers: int, timing: Timing, wait: object) -> Step:
        late = 0.0 if viewers <= self.generator else 50.0
        slow = viewers > min(self.capacity, self.generator)
        return replace(GOOD, viewers=viewers, p95_ms=400 if slow else self.p95_ms, generator=Generator(0.1, 0.5, late))


def measured(made: Made, steps: int = 14) -> tuple[Capacity, list[int]]:
    capacity, tried = Capacity(100), []
    measure_capacity(
        cast(Subject, made), capacity, 4, 400, steps, TIMING, lambda step: tried.append(step.viewers), lambda *_: None
    )
    return capacity, tried


def test_what_is_beyond_the_largest_number_is_measured_too() -> None:
    capacity, tried = measured(Made(40))
    assert (capacity.viewers, capacity.found) == (40, True)
    assert tried[-3:] == [40, 60, 80]
    assert [step.p95_ms for step in capacity.beyond] == [20, 400, 400]
    most, *beyond = verdict(capacity)
    assert most == "40 viewers are the most with p95 ≤ 100 ms and all served."
    assert beyond[2] == (
        "Offered 2 times as many, 80: 80 inside, p50 10.0 ms, p95 400.0 ms, 30 frames/s, 100 % of the most."
    )


def test_no_number_is_told_that_the_viewers_could_not_try() -> None:
    capacity, _ = measured(Made(200, generator=40))
    assert (capacity.viewers, capacity.found) == (40, False)
    assert verdict(capacity)[0].startswith("At least 40 viewers")


def test_nothing_is_told_where_even_one_viewer_was_too_much_for_the_viewers() -> None:
    capacity, _ = measured(Made(200, generator=0))
    assert (capacity.viewers, capacity.found, capacity.beyond) == (0, False, [])
    assert verdict(capacity)[0].startswith("Nothing is known of the service: the viewers' processes were 50 ms late")


def test_a_search_that_is_cut_short_says_what_it_knows() -> None:
    capacity, tried = measured(Made(400), steps=3)
    assert tried[:3] == [4, 8, 16]
    assert (capacity.viewers, capacity.found) == (16, False)


def test_two_services_are_measured_in_turns() -> None:
    order: list[str] = []

    def made(name: str, p95_ms: float) -> Any:
        one = Made(10, p95_ms=p95_ms)
        steps = one.step
        one.step = lambda *given: order.append(name) or steps(*given)  # type: ignore[method-assign, func-returns-value]
        return one

    comparison = compare(made("new", 30), made("old", 20), 4, 6, TIMING, lambda step: None, lambda *_: None)
    assert order == ["new", "old", "old", "new"] * 3
    ratio = comparison.ratio(lambda step: step.p95_ms)
    assert ratio is not None
    assert ratio.value == pytest.approx(1.5)
    assert comparison_lines(comparison)[1] == "4 viewers, p95: 1.500 times the baseline's [1.500, 1.500]"


def found(capacity: int, first: int = 4, most: int = 400) -> tuple[int, list[int]]:
    """The result of a search for `capacity`, and the numbers tried."""
    looking, tried = search(first, most), []
    try:
        viewers = next(looking)
        while True:
            tried.append(viewers)
            viewers = looking.send(viewers <= capacity)
    except StopIteration as end:
        return end.value, tried


@pytest.mark.parametrize("capacity", [*range(20), 71, 100, 150, 399, 400])
def test_it_is_found_within_a_twentieth(capacity: int) -> None:
    value, tried = found(capacity)
    assert 0.95 * capacity - 1 <= value <= capacity
    assert len(tried) == len(set(tried)) <= 14
    assert max(tried) <= 400


def test_nothing_above_the_most_is_tried_and_nothing_twice() -> None:
    assert found(1000, most=50) == (50, [4, 8, 16, 32, 50])
    assert found(0) == (0, [4, 2, 1])
