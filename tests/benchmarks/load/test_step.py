"""Verdict of a step on the service, and steps without a verdict."""

from __future__ import annotations

import math

import pytest

from benchmarks.load.measure import Capacity, Ratio
from benchmarks.load.step import Observed, ServerUse, Step
from benchmarks.load.viewer import Due


def frames(count: int = 300, took: float = 0.02, lag: float = 0.0) -> list[Due]:
    """Served frames, spread over ten seconds of the clock from 100 on."""
    return [Due(100 + 10 * n / count, "served", took, 100 + 10 * n / count + took, 23_000, lag) for n in range(count)]


def step(ended: list[Due], waiting: list[float] | None = None, outside: int = 0, cpu: float = 1.0) -> Step:
    return Step.of(1, 10.0, Observed.of(ended, waiting or [], (100.0, 110.0), outside, cpu), ServerUse(0.5, 210.0, 40))


def test_figures_of_a_service_that_keeps_up() -> None:
    one = step(frames())
    assert (one.due, one.served, one.lost) == (300, 1.0, {})
    assert (one.p50_ms, one.p95_ms) == (20.0, 20.0)
    assert one.frames_per_s == pytest.approx(30, abs=0.2)
    assert one.mbit_per_s == pytest.approx(300 * 23_000 * 8 / 10 / 1e6)
    assert one.kilobytes == 23.0
    assert one.generator.cpu == 0.1
    assert one.generator.cpu_ms == pytest.approx(1000 / 300)
    assert one.bottleneck is None


def test_only_frames_that_were_due_meanwhile_count() -> None:
    one = step([*frames(), Due(99.9, "served", 0.5, 100.4, 1, 0), Due(110.1, "superseded")], waiting=[99.0, 111.0])
    assert (one.due, one.p95_ms) == (300, 20.0)
    assert one.frames_per_s == pytest.approx(30.1, abs=0.2)  # one of them arrived in the meantime


def test_all_that_was_not_served_is_told_apart() -> None:
    lost = [Due(101.0, fate) for fate in ("late", "superseded", "late", "waiting")]
    one = step([*frames(), *lost], waiting=[105.0])
    assert one.lost == {"late": 2, "missing": 1, "superseded": 1, "waiting": 1}
    assert one.served == 300 / 305


def test_intervals_hold_the_value_and_grow_with_what_varies() -> None:
    uneven = step([*frames(150, 0.02), *frames(150, 0.08)])
    low, high = uneven.p95_interval
    assert low <= uneven.p95_ms <= high
    steady = step(frames())
    assert steady.p95_interval == (20.0, 20.0)


def test_a_step_without_frames_has_no_latency() -> None:
    one = step([Due(101.0, "outside")], outside=1)
    assert math.isnan(one.p95_ms)
    assert one.served == 0


def test_viewers_that_are_too_slow_themselves_say_nothing_of_the_service() -> None:
    assert "computed 90% of the time" in (step(frames(), cpu=9.0).bottleneck or "")
    assert "8 ms late" in (step(frames(lag=0.008)).bottleneck or "")
    assert step(frames(took=0.2, lag=0.008)).bottleneck is None


def test_several_processes_count_together() -> None:
    span = (100.0, 110.0)
    parts = [Observed.of(frames(), [], span, 0, 1.0), Observed.of([Due(105.0, "reset")], [], span, 1, 9.0)]
    both = Step.of(2, 10.0, Observed.together([Observed.from_json(part.to_json()) for part in parts]), None)
    assert (both.due, both.outside, both.lost) == (301, 1, {"reset": 1})
    assert both.generator.cpu == 0.9


@pytest.mark.parametrize(
    ("ended", "outside", "holds"),
    [
        (frames(), 0, True),
        (frames(took=0.101), 0, False),
        ([*frames(), Due(101.0, "superseded")], 0, False),
        (frames(), 1, False),
        ([], 0, False),
    ],
)
def test_capacity_counts_viewers_who_have_all_their_frames_in_time(ended: list[Due], outside: int, holds: bool) -> None:
    assert Capacity(100).holds(step(ended, outside=outside)) is holds


def test_ratios_are_geometric_means_of_pairs_with_an_interval() -> None:
    ratio = Ratio.of([(1.0, 2.0), (4.0, 2.0)])
    assert ratio == Ratio(pytest.approx(1.0), None)  # type: ignore[arg-type]
    ratio = Ratio.of([(1.1, 1.0), (1.0, 1.0)] * 4)
    assert ratio is not None
    assert ratio.interval is not None
    assert 1.0 < ratio.interval[0] < ratio.value < ratio.interval[1] < 1.1
    assert Ratio.of([(math.nan, 1.0)]) is None
