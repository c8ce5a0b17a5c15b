"""Neighbours in space are neighbours in Z-order."""

from __future__ import annotations

import numpy as np
import pytest

from tigas_render.raster.morton import morton_codes


def test_neighbours_in_space_are_neighbours_in_order() -> None:
    points = np.random.default_rng(0).random((4096, 3))
    ordered = points[morton_codes(points).argsort()]
    steps, random_steps = (np.linalg.norm(np.diff(p, axis=0), axis=1).mean() for p in (ordered, points))
    assert steps < 0.25 * random_steps


@pytest.mark.parametrize("factor", [1e9, 1e30])
def test_a_few_points_far_away_do_not_make_the_grid_coarse(factor: float) -> None:
    points = np.random.default_rng(0).random((1000, 3), np.float32)
    points[:5] *= factor
    assert len(set(morton_codes(points).tolist())) > 990


def test_no_points_have_no_codes() -> None:
    assert morton_codes(np.zeros((0, 3))).tolist() == []
