"""Means over blocks and their intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tigas_experiments.report.estimates import LEAST_BLOCKS, Estimate, paired, signed
from tigas_experiments.report.metrics import METRICS

AGE = METRICS["frame_age_mean_ms"]


def estimate(*values: float, step: float = 0.0) -> Estimate:
    """Of at least one block."""
    found = Estimate.over(values, step)
    assert found is not None
    return found


def test_an_interval_is_that_of_the_mean_and_always_the_same() -> None:
    values = np.random.default_rng(5).normal(10, 2, 40).tolist()
    found = estimate(*values)
    half = 1.96 * np.std(values) / math.sqrt(len(values))
    assert found.interval == pytest.approx((np.mean(values) - half, np.mean(values) + half), rel=0.02)
    assert estimate(*values) == found
    assert found.certain


def test_a_few_blocks_have_no_interval() -> None:
    few = estimate(*[1.0] * (LEAST_BLOCKS - 1))
    assert (few.interval, few.certain) == (None, False)
    assert estimate(*[1.0] * LEAST_BLOCKS).interval == (1, 1)
    assert Estimate.over([]) is None


def test_the_mean_of_equal_values_is_one_of_them() -> None:
    assert sum([0.1] * 6) / 6 < 0.1, "else there is nothing to test"
    found = estimate(*[0.1] * 6)
    assert found.low == found.mean == found.high


def test_equal_differences_are_known_no_better_than_the_display_shows_them() -> None:
    step = METRICS["motion_to_photon_p95_ms"].step
    equal, less, none = (estimate(*[value] * 6, step=step) for value in (16.7, 5.0, 0.0))
    assert equal.interval == pytest.approx((16.7 - 1000 / 120, 16.7 + 1000 / 120))
    assert (equal.certain, less.certain) == (True, False)
    assert none.interval == (0, 0)


def test_what_never_came_leaves_one_end_open() -> None:
    some, none = estimate(*[40.0] * 5, math.inf), estimate(*[math.inf] * 6)
    assert (some.mean, some.interval) == (math.inf, (40, math.inf))
    assert (none.interval, estimate(-math.inf, *[40.0] * 5).interval) == ((math.inf, math.inf), (-math.inf, 40))
    assert some.interval_text(AGE) == "[40, ∞]"


def test_differences_are_within_blocks() -> None:
    found = paired({"a": 50.0, "b": math.inf, "c": 1.0}, {"a": 20.0, "b": math.inf})
    assert found == {"a": 30, "b": 0}, "both never came: none is the slower"
    assert [signed(AGE, value) for value in (30.0, -4.2, 0.0, math.inf, math.nan)] == ["+30", "-4", "0", "∞", "–"]


def test_a_range_is_of_runs_and_empty_if_they_are_equal() -> None:
    found = [estimate(40.0, 50.0, 90.0), estimate(70.0), estimate(40.0, math.inf)]
    assert [each.range_text(AGE) for each in found] == ["40–90", "", "40–never"]
    runs = Estimate.over([50.0], runs=[40.0, 60.0])
    assert runs is not None
    assert runs.range_text(AGE) == "40–60"
