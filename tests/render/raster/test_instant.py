"""Synthetic frames have the requested size in bytes, and are valid pictures."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from tigas_common.pose import Intrinsics, Pose
from tigas_render.raster.base import Camera, one_gaussian
from tigas_render.raster.devices import create_rasterizer
from tigas_render.raster.instant import DEFAULT_BYTES

LENS = Intrinsics(300, 300, 320, 180, 640, 360)
CAMERA = Camera(Pose.from_euler(0, 0, 0, (0, 0, 0)), LENS)


@pytest.mark.parametrize(("device", "size"), [("instant", DEFAULT_BYTES), ("instant:200000", 200_000)])
def test_a_jpeg_of_so_many_bytes(device: str, size: int) -> None:
    rasterizer = create_rasterizer(device)
    jpeg = rasterizer.render(rasterizer.prepare(one_gaussian()), CAMERA).encode("jpeg", 90)
    assert len(jpeg) == size
    picture = np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))
    assert picture.shape == (360, 640, 3)
    assert np.ptp(picture) == 0


def test_other_formats_are_pictures_too() -> None:
    rasterizer = create_rasterizer("instant:10")
    scene = rasterizer.prepare(one_gaussian())
    png = rasterizer.render(scene, CAMERA, "png").encode("png", 90)
    assert Image.open(io.BytesIO(png)).size == (640, 360)
    assert len(rasterizer.render(scene, CAMERA, "yuv420p").encode("yuv420p", 90)) == 640 * 360 * 3 // 2
    assert len(rasterizer.render(scene, CAMERA).encode("jpeg", 90)) > 10
