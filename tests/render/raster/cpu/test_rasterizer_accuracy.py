"""The CPU rasteriser matches the reference for any picture and camera, and gsplat's pictures of captured scenes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from reference.rasterizer import ReferenceRasterizer
from tests.render.raster.views import camera, cloud, gsplat_frames, pixels, psnr
from tests.shared_data import reference_scene_ply, shared_file
from tigas_common.pose import Intrinsics, Pose, Vector3
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, depth_size
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.raster.cpu import rasterizer as cpu_rasterizer
from tigas_render.scenes.directory import read_scene_file

FAST, SLOW = CpuRasterizer(), ReferenceRasterizer()
SIZES = [(64, 48), (37, 41), (1, 1), (400, 20), (20, 400), (333, 7), (129, 65)]
PLACES: dict[str, Vector3] = {
    "outside": (0.0, 0.0, -4.0),
    "inside": (0.0, 0.0, 0.0),
    "among": (0.3, -0.2, -1.0),
    "looking away": (0.0, 0.0, 3.5),
}


def agreement(gaussians: Gaussians, view: Camera) -> float:
    """PSNR between the two rasterisers."""
    return psnr(pixels(FAST.render(FAST.prepare(gaussians), view)), pixels(SLOW.render(SLOW.prepare(gaussians), view)))


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize(("width", "height"), SIZES, ids=lambda side: str(side))
def test_all_degrees_and_shapes(degree: int, width: int, height: int) -> None:
    gaussians = cloud(1500, degree, seed=degree)
    for place in PLACES.values():
        pose = Pose.from_euler(20, 10, 30, place)
        focal = 0.6 * max(width, height)
        lens = Intrinsics(focal, 1.1 * focal, 0.45 * width, 0.6 * height, width, height)
        assert agreement(gaussians, Camera(pose, lens, (0.2, 0.5, 0.9))) >= 55


@pytest.mark.parametrize(("width", "height"), [*SIZES, (250, 200)], ids=lambda side: str(side))
@pytest.mark.parametrize("place", ["outside", "among"])
def test_depth_is_the_references_and_costs_no_pixel(place: str, width: int, height: int) -> None:
    gaussians = cloud(1500, 0, seed=1, size=0.15)
    focal = 0.6 * max(width, height)
    lens = Intrinsics(focal, 1.1 * focal, 0.45 * width, 0.6 * height, width, height)
    view = Camera(Pose.from_euler(20, 10, 30, PLACES[place]), lens, (0.2, 0.5, 0.9))
    scene = FAST.prepare(gaussians)
    with FAST.render(scene, view) as plain, FAST.render(scene, view, depth=True) as image:
        assert (image.to_host() == plain.to_host()).all()
        assert plain.depth is None
        depth = image.depth
    expected = SLOW.render(SLOW.prepare(gaussians), view, depth=True).depth
    assert depth is not None
    assert expected is not None
    assert depth.shape == expected.shape == depth_size(width, height)[::-1]
    edge = (depth == 0) != (expected == 0)  # hardly any opacity, and just enough in one of them
    assert edge.mean() <= 0.005
    error, norm = np.linalg.norm((depth - expected)[~edge]), np.linalg.norm(expected)
    # Values between two pixels of the map are even within a cell of 2 × 2, where they may be uneven.
    in_whole_cells = (height, width) in (depth.shape, tuple(2 * side for side in depth.shape))
    assert error <= (1e-5 if in_whole_cells else 0.01) * norm


def test_depth_survives_pauses_and_what_is_drawn_in_them() -> None:
    scene, view = FAST.prepare(cloud(3000, 0, seed=2, size=0.15)), camera(320, 200)

    def draw_another() -> None:
        FAST.render(scene, camera(100, 60), depth=True).close()

    with (
        FAST.render(scene, view, depth=True) as image,
        FAST.render(scene, view, pause=draw_another, depth=True) as paused,
    ):
        assert image.depth is not None
        assert paused.depth is not None
        assert (image.depth == paused.depth).all()


@pytest.mark.parametrize("size", [0.002, 0.5, 3.0])
def test_specks_and_giants(size: float) -> None:
    assert agreement(cloud(1000, 1, size=size), camera(96, 64)) >= 55


@pytest.mark.parametrize("display_scale", [1.001, 4 / 3, 2, 4, 20])
@pytest.mark.parametrize("size", [0.002, 0.05, 3.0])
def test_pictures_that_are_shown_larger(size: float, display_scale: float) -> None:
    gaussians = cloud(1000, 1, size=size)
    needles = dataclasses.replace(gaussians, scales=gaussians.scales * np.array([4.0, 0.01, 0.01], np.float32))
    for scene in (gaussians, needles):
        assert agreement(scene, camera(96, 64, background=(0.2, 0.4, 0.6), display_scale=display_scale)) >= 55


def test_a_dense_wall_ends_early_in_both() -> None:
    gaussians = dataclasses.replace(cloud(4000, 1, size=0.3), opacities=np.ones(4000, np.float32))
    assert agreement(gaussians, camera(96, 64, background=(1.0, 1.0, 1.0))) >= 55


@pytest.mark.parametrize("focal", [5.0, 50.0, 5000.0])
@pytest.mark.parametrize("centre", [-200.0, 40.0, 300.0])
def test_unusual_lenses(focal: float, centre: float) -> None:
    lens = Intrinsics(focal, 0.5 * focal, centre, 0.5 * centre, 80, 60)
    for position in ((0.0, 0.0, -4.0), (0.1, 0.0, -0.5)):
        pose = Pose.from_euler(0, 0, 0, position)
        assert agreement(cloud(1500, 1), Camera(pose, lens)) >= 55


def test_needles_cross_tiles_at_every_angle() -> None:
    gaussians = cloud(300, 0, seed=5)
    needles = dataclasses.replace(gaussians, scales=np.tile(np.array([1.0, 0.004, 0.004], np.float32), (300, 1)))
    assert agreement(needles, camera(200, 150)) >= 55


def test_many_gaussians_that_need_several_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    gaussians, view = cloud(3000, 1, size=0.2), camera(300, 200)
    whole = pixels(FAST.render(FAST.prepare(gaussians), view))
    monkeypatch.setattr(cpu_rasterizer, "MAX_ENTRIES", 1000)
    assert (pixels(FAST.render(FAST.prepare(gaussians), view)) == whole).all()


@pytest.mark.parametrize("name", ["guitar", "flowers", "narcissus"])
def test_every_frame_of_gsplat_is_matched(name: str) -> None:
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(read_scene_file(reference_scene_ply(name)).load())
    with np.load(shared_file("reference", "gsplat_renders.npz")) as renders:
        for camera, frame in gsplat_frames(renders, name):
            assert psnr(pixels(rasterizer.render(scene, camera)), frame) >= 60
