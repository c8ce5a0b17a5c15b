"""Bytes and errors of settings: only size and quality cost anything."""

from __future__ import annotations

from itertools import islice

import pytest
import torch

from tests.render.arrays import gaussians_of
from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.sample_cameras import SceneAxes
from tigas_common.wire.render import StartCamera
from tigas_render.gaussians import Gaussians
from tigas_render.ladder.measure import CANDIDATES, DISPLAY, SIZES, measure_views, random_walks
from tigas_render.raster.cpu.rasterizer import CpuRasterizer

AHEAD = Pose.look_at((0.0, 0.0, -4.0), (0.0, 0.0, 0.0), (0.0, -1.0, 0.0))
AWAY = Pose.look_at((0.0, 0.0, -4.0), (0.0, 0.0, -9.0), (0.0, -1.0, 0.0))


def cloud(number: int = 400) -> Gaussians:
    chance = torch.Generator().manual_seed(5)
    return gaussians_of(
        means=torch.rand(number, 3, generator=chance) * 4 - 2,
        scales=torch.full((number, 3), 0.12),
        quaternions=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(number, 1),
        opacities=torch.full((number,), 0.8),
        sh=torch.randn(number, 1, 3, generator=chance),
    )


def test_candidates_are_even_and_of_the_displays_shape() -> None:
    assert SIZES[0] == DISPLAY
    assert all(width * 9 == height * 16 and width % 2 == height % 2 == 0 for width, height in SIZES)
    assert len(set(CANDIDATES)) == len(CANDIDATES)


def test_more_pixels_and_more_quality_take_more_and_lose_less() -> None:
    rasterizer, done = CpuRasterizer(), list[float]()
    settings = [(1280, 720, 90), (640, 360, 90), (640, 360, 20), (256, 144, 20)]
    poses = iter([AWAY, AHEAD, AHEAD])  # empty views do not count
    points = measure_views(
        rasterizer, rasterizer.prepare(cloud()), (0.0, 0.0, 0.0), poses, settings, done.append, views=1
    )
    assert [(point.width, point.height, point.quality) for point in points] == settings
    sizes, errors = [point.kb for point in points], [point.mse for point in points]
    assert sizes == sorted(sizes, reverse=True)
    assert errors == sorted(errors)
    assert points[0].psnr_db > 38
    assert done == [0.25, 0.5, 0.75, 1.0]
    assert next(poses) is AHEAD


def test_a_scene_that_shows_nothing_has_no_ladder() -> None:
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(cloud())
    with pytest.raises(StartError, match="are empty"):
        measure_views(rasterizer, scene, (0.0, 0.0, 0.0), [AWAY] * 9, [(640, 360, 50)], lambda done: None, views=2)


def test_walks_are_the_same_ones_for_a_seed_and_stay_near_the_start_camera() -> None:
    axes = SceneAxes.from_camera(StartCamera(position=(0, 0, -10), look_at=(0, 0, 0)), (0, -1, 0))
    poses = list(islice(random_walks(axes, "a"), 30))
    assert poses == list(islice(random_walks(axes, "a"), 30)) != list(islice(random_walks(axes, "b"), 30))
    assert all(abs(pose.position[0]) < 6 and -16 < pose.position[2] < -4 for pose in poses)
    assert len({pose.position for pose in poses}) == 30
