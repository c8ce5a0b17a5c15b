"""PlayCanvas' compressed PLY: what is read is what was written. `test_formats` reads what others have written."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.render.scenes import plys
from tigas_render.downloads.order import download_order
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.compressed_ply import write_compressed_ply
from tigas_render.scenes.directory import read_scene_file


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
@pytest.mark.parametrize("count", [1, 256, 20_000])
def test_what_is_read_is_what_was_written(tmp_path: Path, count: int, sh_degree: int) -> None:
    gaussians = plys.gaussians(count, sh_degree)
    order = download_order(gaussians, (0, 0, 0)).indices
    write_compressed_ply(tmp_path / "a.ply", gaussians, order, ["a remark"])
    read = read_scene_file(tmp_path / "a.ply").load()
    header, _, content = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    elements = re.findall(rb"element (\w+)", header)
    assert elements == [b"chunk", b"vertex", b"sh"][: 3 if sh_degree else 2], "first rows can be shown by themselves"
    chunks, sh_bytes = -(-count // 256), 3 * ((sh_degree + 1) ** 2 - 1)
    assert len(content) == 72 * chunks + (16 + sh_bytes) * count
    expected = Gaussians(*(array[order] for array in gaussians.arrays))
    extent = float(np.ptp(gaussians.means, axis=0).max())
    assert np.allclose(read.means, expected.means, atol=extent / 1023 / 2 + 1e-6)
    assert np.allclose(read.scales, expected.scales, rtol=np.log(101) / 1023)
    assert np.allclose(read.opacities, expected.opacities, atol=0.51 / 255)
    alike = np.abs((read.quaternions * expected.quaternions).sum(1))  # q and -q are the same rotation
    assert alike.min() > 0.99999
    codes = np.rint((read.sh[:, 1:] / 8 + 0.5) * 256 - 0.5).clip(0, 255)
    as_the_engine = codes * (8 / 255) - 4  # PlayCanvas' engine decodes bytes otherwise than its tools
    assert np.allclose(as_the_engine, expected.sh[:, 1:].clip(-4, 4), atol=0.54 * 8 / 255)
    span = float(np.ptp(gaussians.sh[:, 0], axis=0).max())
    assert np.allclose(read.sh[:, 0], expected.sh[:, 0], atol=span / 255 / 2 + 1e-5)


def test_gaussians_that_are_all_alike_keep_their_values(tmp_path: Path) -> None:
    same = Gaussians(*(array.repeat(300, 0) for array in plys.gaussians(1).arrays))
    write_compressed_ply(tmp_path / "a.ply", same, np.arange(300))
    read = read_scene_file(tmp_path / "a.ply").load()
    assert np.allclose(read.means, same.means)
    assert np.allclose(read.scales, same.scales)
    assert np.allclose(read.sh, same.sh, atol=1e-5)


def test_a_scale_of_zero_is_very_small(tmp_path: Path) -> None:
    flat = plys.gaussians(256)
    flat.scales[:, 2] = 0
    write_compressed_ply(tmp_path / "a.ply", flat, np.arange(256))
    assert read_scene_file(tmp_path / "a.ply").load().scales[:, 2].max() < 1e-8
