"""PlayCanvas' compressed PLY, read as PlayCanvas' engine reads it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.render.downloads.playcanvas_ply import read_compressed_ply
from tests.render.scenes import plys
from tigas_render.downloads.order import Order
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.compressed_ply import write_compressed_ply


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
@pytest.mark.parametrize("count", [1, 256, 20_000])
def test_what_is_read_is_what_was_written(tmp_path: Path, count: int, sh_degree: int) -> None:
    gaussians = plys.gaussians(count, sh_degree)
    order = Order.of(gaussians, (0, 0, 0)).with_neighbours_together(gaussians).indices
    write_compressed_ply(tmp_path / "a.ply", gaussians, order, ["a remark"])
    read = read_compressed_ply(tmp_path / "a.ply")
    chunks = -(-count // 256)
    sh_bytes = 3 * ((sh_degree + 1) ** 2 - 1)
    header = (tmp_path / "a.ply").read_bytes().index(b"end_header\n") + 11
    assert (tmp_path / "a.ply").stat().st_size == header + 72 * chunks + (16 + sh_bytes) * count
    expected = Gaussians(*(array[order] for array in gaussians.arrays))
    extent = float(np.ptp(gaussians.means, axis=0).max())
    assert np.allclose(read.means, expected.means, atol=extent / 1023 / 2 + 1e-6)
    assert np.allclose(read.scales, expected.scales, rtol=np.log(101) / 1023)
    assert np.allclose(read.opacities, expected.opacities, atol=0.51 / 255)
    alike = np.abs((read.quaternions * expected.quaternions).sum(1))  # q and -q are the same rotation
    assert alike.min() > 0.99999
    assert np.allclose(read.sh[:, 1:], expected.sh[:, 1:].clip(-4, 4), atol=0.54 * 8 / 255)
    span = float(np.ptp(gaussians.sh[:, 0], axis=0).max())
    assert np.allclose(read.sh[:, 0], expected.sh[:, 0], atol=span / 255 / 2 + 1e-5)


def test_its_first_rows_are_a_scene(tmp_path: Path) -> None:
    gaussians = plys.gaussians(1000, sh_degree=2)
    write_compressed_ply(tmp_path / "a.ply", gaussians, np.arange(1000))
    part = read_compressed_ply(tmp_path / "a.ply", 300)
    assert len(part) == 300
    assert part.sh_degree == 0
    assert np.allclose(part.means, gaussians.means[:300], atol=0.01)


def test_gaussians_that_are_all_alike_keep_their_values(tmp_path: Path) -> None:
    same = Gaussians(*(array.repeat(300, 0) for array in plys.gaussians(1).arrays))
    write_compressed_ply(tmp_path / "a.ply", same, np.arange(300))
    read = read_compressed_ply(tmp_path / "a.ply")
    assert np.allclose(read.means, same.means)
    assert np.allclose(read.scales, same.scales)
    assert np.allclose(read.sh, same.sh, atol=1e-5)


def test_a_scale_of_zero_is_very_small(tmp_path: Path) -> None:
    flat = plys.gaussians(256)
    flat.scales[:, 2] = 0
    write_compressed_ply(tmp_path / "a.ply", flat, np.arange(256))
    assert read_compressed_ply(tmp_path / "a.ply").scales[:, 2].max() < 1e-8
