"""The order of a download: what covers most of the picture comes first."""

from __future__ import annotations

import torch

from tigas_render.downloads.order import by_importance
from tigas_render.gaussians import Gaussians


def line(*, depths: list[float], radii: list[float], opacities: list[float]) -> Gaussians:
    """Round Gaussians in front of the origin."""
    n = len(depths)
    return Gaussians(
        means=torch.tensor([[0.0, 0.0, depth] for depth in depths]),
        scales=torch.tensor(radii)[:, None].repeat(1, 3),
        quaternions=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(n, 1),
        opacities=torch.tensor(opacities),
        sh=torch.zeros(n, 1, 3),
    )


def test_what_is_large_near_and_opaque_comes_first() -> None:
    gaussians = line(depths=[10, 10, 20, 10], radii=[1, 2, 2, 1], opacities=[0.5, 0.5, 0.5, 0.9])
    assert by_importance(gaussians, (0, 0, 0)).tolist() == [1, 3, 0, 2]


def test_a_needle_counts_for_less_than_a_disc() -> None:
    gaussians = line(depths=[10, 10], radii=[1, 1], opacities=[0.5, 0.5])
    gaussians.scales[0] = torch.tensor([2.0, 0.1, 0.1])
    gaussians.scales[1] = torch.tensor([1.0, 0.01, 1.0])
    assert by_importance(gaussians, (0, 0, 0)).tolist() == [1, 0]


def test_a_speck_before_the_lens_is_not_what_matters() -> None:
    gaussians = line(depths=[0.001, 10, 10, 10], radii=[0.01, 1, 1, 1], opacities=[0.9] * 4)
    assert by_importance(gaussians, (0, 0, 0)).tolist() == [1, 2, 3, 0]
