"""The CPU rasteriser matches gsplat's pictures from a GPU, for real captured scenes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.raster.views import gsplat_frames, pixels, psnr
from tests.shared_data import reference_scene_ply, shared_file
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.directory import read_scene_file


@pytest.mark.parametrize("name", ["guitar", "flowers", "narcissus"])
def test_every_frame_of_gsplat_is_matched(name: str) -> None:
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(read_scene_file(reference_scene_ply(name)).load())
    with np.load(shared_file("reference", "gsplat_renders.npz")) as renders:
        for camera, frame in gsplat_frames(renders, name):
            assert psnr(pixels(rasterizer.render(scene, camera)), frame) >= 60
