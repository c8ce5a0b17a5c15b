"""Copies of a scene side by side: every one of them is the scene, on its ground plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.command import tigas
from tests.render.scenes import made_up, plys
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.copies import write_grid
from tigas_render.scenes.directory import read_scene_file

SIZE = 512
"""Gaussians of a copy of the made-up scene: whole chunks."""


@pytest.mark.parametrize("antialiased", [False, True])
def test_each_copy_is_the_scene_moved_along_the_ground(tmp_path: Path, antialiased: bool) -> None:
    shell = Gaussians(*made_up.shell().arrays, antialiased=antialiased)
    assert write_grid(tmp_path / "grid.ply", shell, (0, 0, 2), 2, 3) == 6 * SIZE
    assert [path.name for path in tmp_path.iterdir()] == ["grid.ply"]
    file = read_scene_file(tmp_path / "grid.ply")
    assert (file.format, file.count, file.sh_degree, file.antialiased) == ("compressed PLY", 6 * SIZE, 1, antialiased)
    read = file.load()
    copies = read.means.reshape(6, SIZE, 3)
    shifts = (copies - copies[0]).mean(1)
    assert np.allclose(copies - copies[0], shifts[:, None], atol=3e-3)
    assert np.allclose(shifts[:, 2], 0, atol=1e-3), "up is z"
    assert len({tuple(np.rint(shift * 10)) for shift in shifts}) == 6
    assert np.linalg.norm(shifts[1:], axis=1).min() > 1.8, "side by side: the scene is 2 wide"
    for copy in range(6):
        drawn = slice(copy * SIZE, copy * SIZE + made_up.COUNT)
        assert sorted(read.opacities[drawn]) == pytest.approx(sorted(shell.opacities), abs=0.01)
        assert not read.opacities[drawn.stop : (copy + 1) * SIZE].any()


def test_scene_grid(tmp_path: Path) -> None:
    result = tigas("scene", "grid", made_up.FILES / "shell.sog", "3x1", tmp_path / "grid.ply")
    assert "grid.ply: 1,536 Gaussians" in result.stdout
    assert read_scene_file(tmp_path / "grid.ply").count == 3 * SIZE


@pytest.mark.parametrize(
    ("size", "out", "sentence"),
    [("0x4", "a.ply", "SIZE: "), ("4", "a.ply", "SIZE: "), ("2x2", "a.sog", "is a compressed PLY")],
)
def test_a_grid_that_cannot_be_is_explained(tmp_path: Path, size: str, out: str, sentence: str) -> None:
    result = tigas("scene", "grid", plys.write(tmp_path / "scene.ply", plys.binary_ply()), size, tmp_path / out)
    assert result.exit_code != 0
    assert sentence in result.stderr
    assert not (tmp_path / out).exists()
