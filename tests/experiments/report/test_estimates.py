"""Means over blocks and their intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import t as student

from tigas_experiments.report.estimates import MIN_PEOPLE, MIN_WINDOWS, Estimate, differences, signed_text, significant
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.report.run_table import Block

AGE = METRICS["frame_age_mean_ms"]


def block(window: int, person: int = 0, network: str = "bus") -> Block:
    return Block(network, float(window), "courtyard", f"{person}.csv", 0.0)


def estimate(*values: float, step: float = 0.0) -> Estimate:
    """Of a network window for each value."""
    found = Estimate.from_blocks({block(window): value for window, value in enumerate(values)}, step)
    assert found is not None
    return found


def crossed(values: NDArray[np.float64]) -> Estimate:
    found = Estimate.from_blocks({block(*place): float(value) for place, value in np.ndenumerate(values)})
    assert found is not None
    return found


def width(found: Estimate) -> float:
    assert found.interval is not None
    return found.interval[1] - found.interval[0]


def test_an_interval_over_independent_windows_is_students() -> None:
    values = np.random.default_rng(5).normal(10, 2, 40)
    found = estimate(*values)
    half = student.ppf(0.975, 39) * np.std(values, ddof=1) / math.sqrt(40)
    assert found.interval == pytest.approx((np.mean(values) - half, np.mean(values) + half))


def test_with_few_windows_there_is_no_interval_however_many_blocks() -> None:
    few = crossed(np.random.default_rng(0).normal(0, 1, (MIN_WINDOWS - 1, MIN_PEOPLE)))
    assert (few.blocks, few.interval, few.p) == (66, None, None)
    assert estimate(*[1.0] * MIN_WINDOWS).interval == (1, 1)
    assert Estimate.from_blocks({}) is None


def test_blocks_that_share_a_window_or_a_person_are_not_independent() -> None:
    generator = np.random.default_rng(1)
    noise = generator.normal(0, 0.1, (MIN_WINDOWS, MIN_PEOPLE))
    independent = crossed(generator.normal(0, 1, noise.shape) + noise)
    of_windows = crossed(generator.normal(0, 1, (MIN_WINDOWS, 1)) + noise)
    of_people = crossed(generator.normal(0, 1, (1, MIN_PEOPLE)) + noise)
    assert width(of_windows) > 1.5 * width(independent)
    assert width(of_people) > 1.5 * width(independent)


def test_a_link_that_never_changes_has_a_window_for_each_part_of_a_movement() -> None:
    parts = {Block("20mbit", None, "courtyard", "walk.csv", 8.0 * part): 1.0 for part in range(MIN_WINDOWS)}
    found = Estimate.from_blocks(parts)
    assert found is not None
    assert found.interval == (1, 1)
    assert len({Block("20mbit", None, scene, "walk.csv", 0.0).window for scene in ("courtyard", "guitar")}) == 1


@pytest.mark.parametrize(
    ("windows", "people", "spread"),
    [
        (MIN_WINDOWS, 1, (1, 0, 1)),
        (MIN_WINDOWS, MIN_PEOPLE, (1, 0, 1)),
        (MIN_WINDOWS, MIN_PEOPLE, (1, 0.5, 1)),
        (MIN_WINDOWS, MIN_PEOPLE, (0.3, 0.3, 1)),
        (2 * MIN_WINDOWS, MIN_PEOPLE, (1, 0.5, 1)),
    ],
)
def test_intervals_cover_the_true_mean_as_often_as_they_say(
    windows: int, people: int, spread: tuple[float, float, float]
) -> None:
    """`spread`: deviations between windows, between people, and within both."""
    generator = np.random.default_rng(7)
    of_windows, of_people, within = spread
    tries, covered = 1000, 0
    for _ in range(tries):
        values = generator.normal(0, of_windows, (windows, 1)) + generator.normal(0, within, (windows, people))
        if people > 1:
            values = values + generator.normal(0, of_people, (1, people))
        low, high = crossed(values).interval or (math.nan, math.nan)
        covered += low <= 0 <= high
    assert 0.93 <= covered / tries <= 0.97


def claims(*p_values: float | None) -> list[Estimate]:
    return [Estimate(float(i), 0, 0, 12, (0, 0), p) for i, p in enumerate(p_values)]


@pytest.mark.parametrize(
    ("p_values", "sure"),
    [
        ([0.04], [0]),
        ([0.04, 0.04], []),
        ([0.02, 0.04], [0, 1]),
        ([0.3, 0.001, None, 0.02], [1, 3]),
        ([0.06], []),
    ],
)
def test_more_claims_in_a_table_need_more_certainty(p_values: Iterable[float | None], sure: list[int]) -> None:
    found = claims(*p_values)
    assert {each.mean for each in significant([*found, None])} == set(sure)


def test_a_p_value_says_what_the_interval_says() -> None:
    generator = np.random.default_rng(3)
    for shift in (0.0, 0.5, 0.7, 2.0):
        found = estimate(*generator.normal(shift, 1, 20))
        assert found.interval is not None
        assert found.p is not None
        assert (found.p < 0.05) == (found.interval[0] > 0 or found.interval[1] < 0)


def test_the_mean_of_equal_values_is_one_of_them() -> None:
    assert sum([0.1] * 6) / 6 < 0.1, "else there is nothing to test"
    found = estimate(*[0.1] * 6)
    assert found.low == found.mean == found.high


def test_equal_differences_are_known_no_better_than_the_display_shows_them() -> None:
    step = METRICS["motion_to_photon_p95_ms"].step
    equal, less, none = (estimate(*[value] * MIN_WINDOWS, step=step) for value in (16.7, 5.0, 0.0))
    assert equal.interval == pytest.approx((16.7 - 1000 / 120, 16.7 + 1000 / 120))
    assert ([*significant([equal])], [*significant([less])]) == ([equal], [])
    assert none.interval == (0, 0)


def test_what_never_came_leaves_one_end_open() -> None:
    finite = [40.0] * (MIN_WINDOWS - 1)
    some, none = estimate(*finite, math.inf), estimate(*[math.inf] * MIN_WINDOWS)
    assert (some.mean, some.interval) == (math.inf, (40, math.inf))
    assert (none.interval, estimate(-math.inf, *finite).interval) == ((math.inf, math.inf), (-math.inf, 40))
    assert some.interval_text(AGE) == "[40, ∞]"


def test_what_never_came_against_better_values_is_not_certain() -> None:
    mixed = estimate(*[-40.0, -41.0] * (MIN_WINDOWS // 2), math.inf, math.inf)
    assert (mixed.mean, [*significant([mixed])]) == (math.inf, [])
    opposite = estimate(*[math.inf, -math.inf] * MIN_WINDOWS)
    assert [*significant([opposite])] == []
    worse = estimate(*[40.0, 41.0] * (MIN_WINDOWS // 2), math.inf, math.inf)
    assert [*significant([worse])] == [worse]


def test_differences_are_within_blocks() -> None:
    found = differences({"a": 50.0, "b": math.inf, "c": 1.0}, {"a": 20.0, "b": math.inf})
    assert found == {"a": 30, "b": 0}, "both never came: none is the slower"
    assert [signed_text(AGE, value) for value in (30.0, -4.2, 0.0, math.inf, math.nan)] == ["+30", "-4", "0", "∞", "–"]


def test_a_range_is_of_runs_and_empty_if_they_are_equal() -> None:
    found = [estimate(40.0, 50.0, 90.0), estimate(70.0), estimate(40.0, math.inf)]
    assert [each.range_text(AGE) for each in found] == ["40–90", "", "40–never"]
    runs = Estimate.from_blocks({block(0): 50.0}, runs=[40.0, 60.0])
    assert runs is not None
    assert runs.range_text(AGE) == "40–60"
