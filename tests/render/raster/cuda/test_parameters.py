"""The kernels read a frame's parameters in the written layout; tiles cover the picture and fit the kernels."""

from __future__ import annotations

import dataclasses
import re
import struct

import pytest
import torch

from tests.render.raster.views import LEVEL, camera, cloud
from tigas_common.pose import Intrinsics, Pose
from tigas_render.raster.base import DILATION, Camera, coarse, footprint
from tigas_render.raster.cuda import compiler
from tigas_render.raster.cuda.levels import EDGE_PIXELS
from tigas_render.raster.cuda.packing import pack
from tigas_render.raster.cuda.parameters import MAX_LISTS, MOST_LISTS, SIZE, frame_parameters, plan_numbers, tile_layout
from tigas_render.raster.cuda.scene import CudaScene


def test_parameters_are_laid_out_as_the_kernels_read_them() -> None:
    source = (compiler.KERNELS / "frame.cuh").read_text()
    struct = source[source.index("struct Frame {") : source.index("constexpr int FRAME_WORDS")]
    lines = [line.split("//")[0].strip() for line in struct.splitlines()[1:]]
    fields = [line for line in lines if line.endswith(";") and "}" not in line]
    pointers = sum("*" in field for field in fields)
    words = 0
    for field in fields:
        if "*" not in field:
            for name in field.rstrip(";").split(" ", 1)[1].split(","):
                size = re.search(r"\[(\d+)\]", name)
                words += int(size[1]) if size else 1
    assert -(-(8 * pointers + 4 * words) // 8) * 8 == SIZE


def floats(scene: CudaScene, view: Camera) -> tuple[float, ...]:
    """The 28 floats at the end of a frame's parameters."""
    k = view.intrinsics
    layout = tile_layout(k.width, k.height, scene.padded)
    plan = plan_numbers(k.width, k.height, scene.padded, layout, "jpeg", (0,) * 18, 0, 0)
    return struct.unpack("=28f", frame_parameters(scene, view, plan)[-112:])


def test_the_rotation_is_from_the_world_to_the_camera_row_by_row() -> None:
    scene = pack(cloud(10, 0).batches(), torch.device("cpu"))
    pose = Pose((1.0, 2.0, 3.0), ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0)))
    view = Camera(pose, Intrinsics(640.0, 640.0, 320.0, 180.0, 640, 360), (0.25, 0.5, 0.75))
    numbers = floats(scene, view)
    assert numbers[2:14] == (1, 4, 7, 2, 5, 8, 3, 6, 9, 1, 2, 3)
    assert numbers[14:18] == (640, 640, 320, 180)
    assert numbers[-4:-1] == (0.25, 0.5, 0.75)


def test_the_shortest_focal_length_has_limits_that_the_kernels_can_hold() -> None:
    scene = pack(cloud(10, 0).batches(), torch.device("cpu"))
    shortest = Camera(Pose((0.0, 0.0, 0.0), LEVEL), Intrinsics(1e-300, 1e-300, 640.0, 360.0, 1280, 720))
    left, right, top, bottom = floats(scene, shortest)[-8:-4]
    assert -3.5e38 < left < 0 < right < 3.5e38
    assert -3.5e38 < top < 0 < bottom < 3.5e38


def test_the_kernels_learn_how_much_larger_the_picture_is_shown() -> None:
    scene = pack(cloud(10, 0).batches(), torch.device("cpu"))
    dilation, low_pass = footprint(2)
    assert floats(scene, camera(640, 360, display_scale=2))[-10:-8] == pytest.approx((dilation, dilation + low_pass))


def test_the_kernels_learn_of_antialiased_training() -> None:
    scene = pack(dataclasses.replace(cloud(10, 0), antialiased=True).batches(), torch.device("cpu"))
    assert floats(scene, camera(640, 360))[-10:-8] == pytest.approx((0, DILATION))


@pytest.mark.parametrize(("full_detail", "edge"), [(False, EDGE_PIXELS), (True, 0.0)])
def test_the_kernels_learn_how_long_a_cells_edge_may_be(full_detail: bool, edge: float) -> None:
    scene = pack(cloud(10, 0).batches(), torch.device("cpu"))
    picture = dataclasses.replace(camera(640, 360), full_detail=full_detail)
    for view in (picture, coarse(picture)):
        assert floats(scene, view)[-1] * max(view.intrinsics.fx, view.intrinsics.fy) == pytest.approx(edge)


SIZES = [(1, 1), (320, 180), (640, 360), (1280, 720), (1920, 1080), (3840, 2160), (8192, 2048), (2048, 8192)]


@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize(("gaussians", "most"), [(100_000, MAX_LISTS), (4_000_000, 500_000), (1 << 28, MOST_LISTS)])
def test_tiles_cover_the_picture_and_their_lists_fit_the_kernels(
    width: int, height: int, gaussians: int, most: int
) -> None:
    tiles = tile_layout(width, height, gaussians)
    assert tiles.columns * tiles.side >= width > (tiles.columns - 1) * tiles.side
    assert tiles.rows * tiles.side >= height > (tiles.rows - 1) * tiles.side
    assert tiles.slices in {4, 8, 16, 32, 64, 128, 256}
    assert tiles.tiles * tiles.slices <= most or tiles.slices == 4


def test_small_pictures_and_small_gaussians_have_small_tiles() -> None:
    assert [tile_layout(width, height, 100_000).side for width, height in SIZES[:4]] == [8, 8, 8, 16]
    assert tile_layout(1280, 720, 3_000_000).side == 8
