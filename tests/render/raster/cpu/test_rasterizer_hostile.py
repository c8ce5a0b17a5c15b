"""Extreme numbers: the CPU rasteriser neither crashes nor draws invalid splats."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.render.raster.views import LEVEL, balls, camera, cloud, pixels
from tigas_common.pose import Intrinsics, Pose
from tigas_render.gaussians import Floats, Gaussians
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.scene_file import normalise

FAST = CpuRasterizer()
BLUE = (0.0, 0.0, 1.0)

magnitude = st.one_of(st.sampled_from([0.0, 1e-30, 1e-3, 0.01, 1.0, 1e9, 1e30]), st.floats(0, 1e9, width=32))
coordinate = st.tuples(magnitude, st.sampled_from([-1.0, 1.0])).map(math.prod)
focal = st.one_of(st.sampled_from([1e-3, 1.0, 1e6]), st.floats(1e-3, 1e6))
centre = st.one_of(st.sampled_from([-1e6, 0.0, 1e6]), st.floats(-1e6, 1e6))


@st.composite
def hostile_gaussians(draw: st.DrawFn) -> Gaussians:
    count = draw(st.integers(1, 6))

    def values(each: st.SearchStrategy[float], columns: int) -> Floats:
        size = count * columns
        numbers = draw(st.lists(each, min_size=size, max_size=size))
        return np.array(numbers, np.float32).reshape(count, columns)

    return Gaussians(
        means=values(coordinate, 3),
        scales=values(magnitude, 3),
        quaternions=normalise(values(coordinate.map(lambda x: x % 7 + 1e-3), 4)).astype(np.float32),
        opacities=values(st.sampled_from([0.0, 1 / 255, 0.5, 1.0]), 1)[:, 0],
        sh=values(coordinate, 12).reshape(count, 4, 3),
    )


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(hostile_gaussians(), coordinate, focal, focal, centre, centre, st.integers(1, 90), st.integers(1, 90))
def test_any_numbers_give_a_picture(
    gaussians: Gaussians, z: float, fx: float, fy: float, cx: float, cy: float, width: int, height: int
) -> None:
    pose = Pose((0.0, 0.0, max(-1e9, min(1e9, z))), LEVEL)
    image = FAST.render(FAST.prepare(gaussians), Camera(pose, Intrinsics(fx, fy, cx, cy, width, height)))
    assert pixels(image).shape == (height, width, 3)


@pytest.mark.parametrize(
    "replaced",
    [
        {"means": np.full((1, 3), math.nan, np.float32)},
        {"means": np.full((1, 3), math.inf, np.float32)},
        {"scales": np.full((1, 3), math.nan, np.float32)},
        {"scales": np.full((1, 3), 1e30, np.float32)},
        {"quaternions": np.full((1, 4), math.nan, np.float32)},
        {"opacities": np.full(1, math.nan, np.float32)},
        {"opacities": np.zeros(1, np.float32)},
        {"means": np.zeros((1, 3), np.float32)},
        {"means": np.array([[0.0, 0.0, 0.009 - 4]], np.float32)},
        {"means": np.array([[0.0, 0.0, -1e9]], np.float32)},
    ],
    ids=str,
)
def test_what_cannot_be_drawn_leaves_the_background(replaced: dict[str, Any]) -> None:
    gaussians = dataclasses.replace(
        balls((0.0, 0.0, 0.0), size=0.1, opacity=1.0, colours=[[1.0, 1.0, 1.0]]), **replaced
    )
    pose = Pose((0.0, 0.0, 0.0 if "means" in replaced and not replaced["means"].any() else -4.0), LEVEL)
    picture = pixels(FAST.render(FAST.prepare(gaussians), camera(40, 30, pose, background=BLUE)))
    assert (picture == (0, 0, 255)).all()


def test_a_scene_without_gaussians_is_its_background() -> None:
    nothing = Gaussians(*(array[:0] for array in cloud(1, 2).arrays))
    scene = FAST.prepare(nothing)
    assert scene.nbytes == 0
    assert (pixels(FAST.render(scene, camera(70, 50, background=BLUE))) == (0, 0, 255)).all()


def test_unbounded_colours_do_not_spoil_their_neighbours() -> None:
    gaussians = balls((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), size=0.2, opacity=0.9, colours=[[1e38, -1e38, 0.5]] * 2)
    picture = pixels(FAST.render(FAST.prepare(gaussians), camera(41, 41)))
    assert picture[20, 20, 0] == 255
    assert picture[20, 20, 1] == 0


@pytest.mark.parametrize(("width", "height"), [(8192, 2), (2, 8192), (8191, 33)])
def test_the_longest_sides(width: int, height: int) -> None:
    gaussians = balls((0.0, 0.0, 0.0), size=1.0, opacity=1.0, colours=[[1.0, 1.0, 1.0]])
    picture = pixels(FAST.render(FAST.prepare(gaussians), camera(width, height, background=BLUE)))
    assert picture[height // 2, width // 2, 0] > 250
    assert tuple(picture[0, 0]) == (0, 0, 255)
