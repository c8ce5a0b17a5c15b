"""Neighbours in space are neighbours in Z-order."""

from __future__ import annotations

import torch

from tigas_render.raster.morton import morton_codes


def test_neighbours_in_space_are_neighbours_in_order() -> None:
    points = torch.rand(4096, 3, generator=torch.Generator().manual_seed(0))
    ordered = points[morton_codes(points).argsort()]
    steps, random_steps = (p.diff(dim=0).norm(dim=1).mean() for p in (ordered, points))
    assert steps < 0.25 * random_steps


def test_a_few_points_far_away_do_not_make_the_grid_coarse() -> None:
    points = torch.rand(1000, 3, generator=torch.Generator().manual_seed(0))
    points[:5] *= 1e30
    assert len(set(morton_codes(points).tolist())) > 990


def test_no_points_have_no_codes() -> None:
    assert morton_codes(torch.zeros(0, 3)).tolist() == []
