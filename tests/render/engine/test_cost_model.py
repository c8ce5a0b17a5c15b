"""Predicted costs of frames are bounded by those of others."""

from __future__ import annotations

import math

import pytest

from tigas_render.engine.cost_model import CostModel

MEDIUM, LARGE, HUGE = 640 * 360, 1280 * 720, 4096 * 4096


def test_nothing_is_known_at_first() -> None:
    costs = CostModel()
    costs.measured("other", "jpeg", LARGE, 0.1)
    costs.measured("scene", "png", LARGE, 0.1)
    assert costs.at_least("scene", "jpeg", LARGE) == 0
    assert costs.at_most("scene", "jpeg", LARGE) == math.inf


def test_frames_of_one_size_cost_what_they_cost_lately() -> None:
    costs = CostModel()
    costs.measured("scene", "jpeg", LARGE, 1.0)
    for _ in range(30):
        costs.measured("scene", "jpeg", LARGE, 0.1)
    assert costs.at_least("scene", "jpeg", LARGE) == costs.at_most("scene", "jpeg", LARGE) == pytest.approx(0.1, 0.05)


def test_other_sizes_are_bounded() -> None:
    costs = CostModel()
    costs.measured("scene", "jpeg", LARGE, 0.16)
    assert costs.at_least("scene", "jpeg", HUGE) == 0.16
    assert costs.at_most("scene", "jpeg", HUGE) == pytest.approx(0.16 * 2**5)
    assert costs.at_least("scene", "jpeg", MEDIUM) == pytest.approx(0.16 / 4)
    assert costs.at_most("scene", "jpeg", MEDIUM) == 0.16


def test_tiny_frames_make_nobody_believe_that_large_ones_take_for_ever() -> None:
    costs = CostModel()
    for _ in range(100):
        costs.measured("scene", "jpeg", 1, 0.1)
    assert costs.at_least("scene", "jpeg", LARGE) == pytest.approx(0.1)


def test_what_is_doubted_fades() -> None:
    costs = CostModel()
    costs.measured("scene", "jpeg", LARGE, 1.0)
    for _ in range(30):
        costs.doubt("scene", "jpeg")
    assert costs.at_least("scene", "jpeg", LARGE) < 0.05
