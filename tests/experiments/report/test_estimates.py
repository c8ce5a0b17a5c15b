"""Means over blocks and their intervals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.experiments.made_up import configuration
from tigas_experiments.report.estimates import LEAST_BLOCKS, Estimate, paired, signed
from tigas_experiments.report.groups import Block
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.wire.run import Network


def block(**changes: Any) -> Block:
    """Of a run over a bus."""
    return Block.of(configuration(**{"network": Network(trace="bus", rtt_ms=20, offset_s=60), **changes}))


def test_repeats_controllers_and_round_trips_share_a_block_and_other_inputs_do_not() -> None:
    same = [block(repeat=3), block(profile="lol+"), block(network=Network(trace="bus", rtt_ms=300, offset_s=60))]
    assert set(same) == {block()}
    other = [
        block(scene="guitar"),
        block(movement="a/orbit.csv"),
        block(movement_offset_s=8.0),
        block(network=Network(trace="bus", rtt_ms=20, offset_s=61)),
        block(network=Network(trace="train", rtt_ms=20, offset_s=60)),
    ]
    assert len({block(), *other}) == 6


def test_an_interval_is_that_of_the_mean_and_always_the_same() -> None:
    values = np.random.default_rng(5).normal(10, 2, 40).tolist()
    estimate = Estimate.over(values)
    assert estimate is not None
    assert estimate.interval is not None
    half = 1.96 * np.std(values) / math.sqrt(len(values))
    assert estimate.interval == pytest.approx((np.mean(values) - half, np.mean(values) + half), rel=0.02)
    assert Estimate.over(values) == estimate
    assert estimate.certain


def test_a_few_blocks_have_no_interval() -> None:
    estimate = Estimate.over([1.0] * (LEAST_BLOCKS - 1))
    assert estimate is not None
    assert (estimate.interval, estimate.certain) == (None, False)
    assert Estimate.over([]) is None
    enough = Estimate.over([1.0] * LEAST_BLOCKS)
    assert enough is not None
    assert enough.interval == (1, 1)


def test_equal_differences_are_known_no_better_than_the_display_shows_them() -> None:
    equal = Estimate.over([16.7] * 6, METRICS["motion_to_photon_p95_ms"].step)
    less = Estimate.over([5.0] * 6, METRICS["motion_to_photon_p95_ms"].step)
    none = Estimate.over([0.0] * 6, METRICS["motion_to_photon_p95_ms"].step)
    assert equal is not None
    assert less is not None
    assert none is not None
    assert equal.interval == pytest.approx((16.7 - 1000 / 120, 16.7 + 1000 / 120))
    assert (equal.certain, less.certain) == (True, False)
    assert none.interval == (0, 0)


def test_what_never_came_leaves_one_end_open() -> None:
    some = Estimate.over([40.0, 40.0, 40.0, 40.0, 40.0, math.inf])
    none = Estimate.over([math.inf] * 6)
    less = Estimate.over([-math.inf, *[40.0] * 5])
    assert some is not None
    assert none is not None
    assert less is not None
    assert (some.mean, some.interval) == (math.inf, (40, math.inf))
    assert (none.interval, less.interval) == ((math.inf, math.inf), (-math.inf, 40))
    assert some.range(METRICS["frame_age_mean_ms"]) == "[40, ∞]"


def test_differences_are_within_blocks() -> None:
    a, b, c = block(scene="a"), block(scene="b"), block(scene="c")
    found = paired({a: 50.0, b: math.inf, c: 1.0}, {a: 20.0, b: math.inf})
    assert found == {a: 30, b: 0}, "both never came: none is the slower"
    texts = [signed(METRICS["frame_age_mean_ms"], value) for value in (30.0, -4.2, 0.0, math.inf, math.nan)]
    assert texts == ["+30", "-4", "0", "∞", "–"]
