"""The order of a download: any first part of it is a picture of the whole scene."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.render.arrays import gaussians_of
from tests.render.scenes import plys
from tigas_common.errors import Overloaded
from tigas_render.downloads.order import MULTIPLE, SHARES, download_order
from tigas_render.gaussians import Gaussians

N = 10_000


def wall(radii: torch.Tensor | float = 0.1, opacities: torch.Tensor | float = 0.5, depth: float = 10.0) -> Gaussians:
    """Round Gaussians on a wall in front of the origin."""
    across = torch.rand(N, 2, generator=torch.Generator().manual_seed(1)) * 4 - 2
    return gaussians_of(
        means=torch.cat((across, torch.full((N, 1), depth)), 1),
        scales=torch.ones(N, 3) * torch.as_tensor(radii).reshape(-1, 1),
        quaternions=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(N, 1),
        opacities=torch.ones(N) * opacities,
        sh=torch.zeros(N, 1, 3),
    )


def share_of_even(gaussians: Gaussians) -> float:
    """How many of the first tenth have an even number."""
    first = download_order(gaussians, (0, 0, 0)).indices[: N // 10]
    return float(np.mean(first % 2 == 0))


@pytest.mark.parametrize("done", range(len(SHARES) + 3))
def test_sorting_can_be_stopped_before_each_step(done: int) -> None:
    steps = iter(range(done))

    def check() -> None:
        if next(steps, None) is None:
            raise Overloaded("The service is stopping.")

    with pytest.raises(Overloaded):
        download_order(wall(), (0, 0, 0), check)


def test_every_gaussian_is_there_once_and_always_at_the_same_place() -> None:
    gaussians = wall()
    order = download_order(gaussians, (0, 0, 0))
    assert sorted(order.indices) == list(range(N))
    assert (order.indices == download_order(gaussians, (0, 0, 0)).indices).all()


def test_what_is_large_opaque_and_near_comes_early_and_the_rest_is_not_left_out() -> None:
    even = torch.arange(N) % 2 == 0
    assert 0.45 < share_of_even(wall()) < 0.55
    assert 0.7 < share_of_even(wall(radii=torch.where(even, 0.3, 0.1))) < 0.8
    assert 0.7 < share_of_even(wall(opacities=torch.where(even, 0.9, 0.1))) < 0.8
    parted = wall()
    parted.means[~even.numpy(), 2] = 30.0
    assert 0.7 < share_of_even(parted) < 0.8


def test_what_covers_nothing_comes_last() -> None:
    even = torch.arange(N) % 2 == 0
    assert share_of_even(wall(radii=torch.where(even, 0.0, 0.1))) == 0


def test_parts_are_of_whole_chunks_and_grow_less_the_more_there_is() -> None:
    parts = download_order(wall(), (0, 0, 0)).parts
    assert len(parts) == len(SHARES)
    assert all(part.count % MULTIPLE == 0 for part in parts)
    growths = [part.growth for part in parts]
    assert growths == sorted(growths, reverse=True)
    assert 1 < growths[-1] < growths[0] < 5
    assert parts[0].comment == f"first 256 growth {growths[0]:.3f}"


def test_a_small_scene_has_no_parts() -> None:
    assert download_order(plys.gaussians(100), (0, 0, 0)).parts == ()
    assert len(download_order(plys.gaussians(1), (0, 0, 0)).indices) == 1


def test_neighbours_come_together_within_each_part() -> None:
    gaussians = wall()

    def extent(indices: np.ndarray[tuple[int], np.dtype[np.int64]]) -> float:
        chunks = gaussians.means[indices[-MULTIPLE * 10 :], :2].reshape(10, MULTIPLE, 2)
        return float(np.ptp(chunks, axis=1).mean())

    assert extent(download_order(gaussians, (0, 0, 0)).indices) < extent(np.arange(N)) / 2
