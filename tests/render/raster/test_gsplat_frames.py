"""The CPU rasteriser draws what gsplat draws on a GPU, of real captured scenes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.raster.views import pixels, psnr
from tests.shared_data import reference_scene_ply, shared_file
from tigas_common.pose import Intrinsics, Pose
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.ply import load_ply


@pytest.mark.parametrize("name", ["guitar", "flowers", "narcissus"])
def test_every_frame_of_gsplat_is_matched(name: str) -> None:
    with np.load(shared_file("reference", "gsplat_renders.npz")) as reference:
        frames, world_to_camera, k = reference[name], reference[f"{name}_w2c"].astype(float), reference[f"{name}_K"]
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(load_ply(reference_scene_ply(name)))
    intrinsics = Intrinsics(float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]), 640, 360)
    for frame, matrix in zip(frames, world_to_camera, strict=True):
        rotation = matrix[:3, :3].T
        position = -rotation @ matrix[:3, 3]
        pose = Pose(tuple(position.tolist()), tuple(map(tuple, rotation.tolist())))
        assert psnr(pixels(rasterizer.render(scene, Camera(pose, intrinsics))), frame) >= 60
