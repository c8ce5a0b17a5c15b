"""The CUDA rasteriser matches the reference, in every format and size, and survives faults."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image as PillowImage

from reference.rasterizer import ReferenceRasterizer, depth_float, render_float
from tests.prerequisites import GPU
from tests.render.raster.cuda.exact_depth import exact_depth
from tests.render.raster.views import balls, camera, cloud, gsplat_frames, psnr
from tests.shared_data import reference_scene_ply, shared_file
from tigas_common.pose import Pose
from tigas_common.wire.render import FrameFormat
from tigas_render.encode.images import encode_yuv420p
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, Depth, coarse, depth_size, inverse_depth
from tigas_render.scenes.directory import read_scene_file

if TYPE_CHECKING:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

pytestmark = GPU.mark
Pixels = NDArray[np.uint8]


@pytest.fixture(scope="module")
def rasterizer(tmp_path_factory: pytest.TempPathFactory) -> CudaRasterizer:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

    return CudaRasterizer(0, tmp_path_factory.mktemp("cache"))


def draw(rasterizer: CudaRasterizer, gaussians: Gaussians, view: Camera) -> Pixels:
    return rasterizer.render(rasterizer.prepare(gaussians), view, "png").to_host()


def decoded(image: bytes) -> Pixels:
    return np.asarray(PillowImage.open(io.BytesIO(image)).convert("RGB"))


def reference(gaussians: Gaussians, view: Camera) -> Pixels:
    return (render_float(gaussians, view, "cuda").clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy()


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_every_degree_of_colour_is_drawn_as_the_reference_draws_it(rasterizer: CudaRasterizer, degree: int) -> None:
    gaussians, view = cloud(20_000, degree), camera(320, 200, background=(0.2, 0.4, 0.6))
    assert psnr(draw(rasterizer, gaussians, view), reference(gaussians, view)) >= 55


@pytest.mark.parametrize("display_scale", [1.001, 4 / 3, 2, 4, 20])
@pytest.mark.parametrize("size", [0.002, 0.05, 0.2])
def test_a_picture_that_is_shown_larger_is_drawn_as_the_reference_draws_it(
    rasterizer: CudaRasterizer, size: float, display_scale: float
) -> None:
    gaussians = cloud(5_000, 1, size=size)
    needles = dataclasses.replace(gaussians, scales=gaussians.scales * np.array([4.0, 0.01, 0.01], np.float32))
    view = camera(320, 180, background=(0.2, 0.4, 0.6), display_scale=display_scale)
    for scene in (gaussians, needles):
        assert psnr(draw(rasterizer, scene, view), reference(scene, view)) >= 50


@pytest.mark.parametrize(
    ("width", "height"), [(1, 1), (7, 5), (33, 17), (320, 180), (641, 359), (1283, 721), (8192, 16), (16, 8192)]
)
def test_every_size_is_drawn_to_its_last_pixel(rasterizer: CudaRasterizer, width: int, height: int) -> None:
    gaussians, view = cloud(3_000, 1), camera(width, height, background=(1.0, 0.5, 0.0))
    assert psnr(draw(rasterizer, gaussians, view), reference(gaussians, view)) >= 50


def test_from_inside_the_cloud_and_beyond_it(rasterizer: CudaRasterizer) -> None:
    gaussians = cloud(5_000, 2)
    for position in ((0.0, 0.0, 0.0), (0.0, 0.0, 1.5), (0.5, -0.3, -1.0)):
        view = camera(200, 150, Pose.from_euler(30, 20, 10, position))
        assert psnr(draw(rasterizer, gaussians, view), reference(gaussians, view)) >= 50
    away = camera(200, 150, Pose.from_euler(180, 0, 0, (0.0, 0.0, -400.0)), background=(0.0, 0.0, 1.0))
    assert (draw(rasterizer, gaussians, away) == (0, 0, 255)).all()


def test_thousands_at_one_depth_in_one_tile_are_sorted_and_drawn(rasterizer: CudaRasterizer) -> None:
    count = 9_000
    random = torch.Generator().manual_seed(1)
    colours = torch.rand(count, 3, generator=random).tolist()
    gaussians = balls(*[(0.0, 0.0, 0.0)] * count, size=0.02, opacity=0.01, colours=colours)
    view = camera(64, 64)
    first = draw(rasterizer, gaussians, view)
    assert psnr(first, reference(gaussians, view)) >= 50
    assert (first == draw(rasterizer, gaussians, view)).all()


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> CudaRasterizer:
    """A rasteriser with buffers too small for the first picture: its lists, and its chunks."""
    from tigas_render.raster.cuda import workspace
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

    monkeypatch.setattr(workspace, "FIRST_CAPACITY", 2048)
    monkeypatch.setattr(workspace, "FIRST_ROOM", 2)
    return CudaRasterizer(0, tmp_path)


def test_a_picture_that_outgrows_the_buffers_is_drawn_after_they_have_grown(
    rasterizer: CudaRasterizer, small: CudaRasterizer
) -> None:
    gaussians, view = cloud(20_000, 0, size=0.2), camera(320, 200)
    assert (draw(small, gaussians, view) == draw(rasterizer, gaussians, view)).all()


def depth_of(rasterizer: CudaRasterizer, gaussians: Gaussians, view: Camera) -> Depth:
    return exact_depth(rasterizer.job(rasterizer.prepare(gaussians), view, "jpeg", 90, depth=True))


@pytest.mark.parametrize(
    ("width", "height"), [(64, 48), (37, 41), (1, 1), (400, 20), (20, 400), (640, 360), (1280, 720), (1921, 1081)]
)
@pytest.mark.parametrize("place", [(0.0, 0.0, -4.0), (0.3, -0.2, -1.0)], ids=["outside", "among"])
def test_depth_is_the_references_of_the_same_coarse_view(
    rasterizer: CudaRasterizer, place: tuple[float, float, float], width: int, height: int
) -> None:
    gaussians = cloud(3_000, 1, size=0.15)
    view = camera(width, height, Pose.from_euler(20, 10, 30, place), background=(0.2, 0.5, 0.9))
    depth = depth_of(rasterizer, gaussians, view)
    assert depth.shape == depth_size(width, height)[::-1]
    means = depth_float(gaussians, coarse(view), "cuda").permute(1, 2, 0)
    expected = inverse_depth(means.cpu().numpy())
    edge = (depth == 0) != (expected == 0)  # practically no opacity, just enough in one of them
    assert edge.mean() <= 0.005
    # A value is kept in 16 bits while it waits to be blended; a few pixels differ in which Gaussians are just opaque.
    error = np.abs(depth - expected)[~edge] / np.maximum(expected[~edge], 0.02)
    assert (error > 5e-3).mean() <= 0.002
    assert error.max(initial=0) <= 0.05


def test_depth_costs_no_pixel_in_any_format(rasterizer: CudaRasterizer) -> None:
    scene, view = rasterizer.prepare(cloud(3_000, 1, size=0.15)), camera(641, 359)
    formats: tuple[FrameFormat, ...] = ("jpeg", "png", "yuv420p")
    depths = []
    for format in formats:
        plain, deep = (rasterizer.render(scene, view, format, depth=depth) for depth in (False, True))
        assert plain.content == deep.content
        assert plain.coded_depth is None
        depths.append(deep.coded_depth)
    assert depths[0] is not None
    assert depths == [depths[0]] * len(formats)


def test_depth_is_whole_after_the_buffers_were_outgrown(rasterizer: CudaRasterizer, small: CudaRasterizer) -> None:
    gaussians, view = cloud(20_000, 0, size=0.2), camera(320, 200)
    assert (depth_of(small, gaussians, view) == depth_of(rasterizer, gaussians, view)).all()


def test_where_nothing_is_depth_is_infinite_whatever_the_frame_before_had(rasterizer: CudaRasterizer) -> None:
    view = camera(640, 360)
    assert depth_of(rasterizer, cloud(3_000, 0, size=0.15), view).max() > 0.1
    nothing = Gaussians(*(array[:0] for array in cloud(1, 0).arrays))
    assert (depth_of(rasterizer, nothing, view) == 0).all()


def test_jpeg_and_yuv_show_what_png_shows(rasterizer: CudaRasterizer) -> None:
    gaussians, view = cloud(3_000, 1), camera(161, 91, background=(0.1, 0.2, 0.3))
    scene = rasterizer.prepare(gaussians)
    exact = draw(rasterizer, gaussians, view)
    jpeg = rasterizer.render(scene, view, quality=95).content
    assert jpeg.startswith(b"\xff\xd8")
    assert jpeg.endswith(b"\xff\xd9")
    assert psnr(decoded(jpeg), exact) >= 28
    assert len(rasterizer.render(scene, view, quality=10).content) < len(jpeg)
    planes = np.frombuffer(rasterizer.render(scene, view, "yuv420p").content, np.uint8).astype(int)
    expected = np.frombuffer(encode_yuv420p(exact), np.uint8).astype(int)
    assert planes.shape == expected.shape
    assert abs(planes - expected).max() <= 1


def test_nothing_to_draw_is_the_background(rasterizer: CudaRasterizer) -> None:
    nothing = Gaussians(*(array[:0] for array in cloud(1, 0).arrays))
    assert (draw(rasterizer, nothing, camera(50, 40, background=(1.0, 0.0, 0.2))) == (255, 0, 51)).all()


@pytest.mark.parametrize("name", ["guitar", "flowers", "narcissus"])
def test_every_frame_of_gsplat_is_matched(rasterizer: CudaRasterizer, name: str) -> None:
    gaussians = read_scene_file(reference_scene_ply(name)).load()
    with np.load(shared_file("reference", "gsplat_renders.npz")) as renders:
        for view, frame in gsplat_frames(renders, name):
            assert psnr(draw(rasterizer, gaussians, view), frame) >= 60


def test_the_reference_itself_agrees_with_its_host_image() -> None:
    gaussians, view = cloud(500, 1), camera(64, 48)
    with ReferenceRasterizer().render(ReferenceRasterizer().prepare(gaussians), view) as image:
        assert psnr(image.to_host(), reference(gaussians, view)) >= 60
