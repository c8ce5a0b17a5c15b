"""Start views of objects: from outside, as near as they fit, and never anything that is not a camera."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.render.arrays import gaussians_of
from tigas_common.pose import Pose
from tigas_common.wire.model import Point
from tigas_common.wire.render import StartCamera
from tigas_render.gaussians import Floats
from tigas_render.scenes.start_view.view import derive_view

UP: Point = (0.0, -1.0, 0.0)


def derive(means: Floats, up: Point = UP) -> StartCamera:
    return derive_uniform(means, 0.9, 0.01, up)


def derive_uniform(means: Floats, opacity: float, scale: float, up: Point = UP) -> StartCamera:
    count = len(means)
    scene = gaussians_of(
        means, np.full((count, 3), scale), np.zeros((count, 4)), np.full(count, opacity), np.zeros((count, 1, 3))
    )
    return derive_view(scene, up).camera


def floats(*rows: list[float]) -> Floats:
    return np.array(rows, np.float32)


def normal(seed: int, count: int = 20_000) -> Floats:
    return np.random.default_rng(seed).standard_normal((count, 3), np.float32)


def on_box(half: tuple[float, float, float], count: int = 20_000) -> Floats:
    """[N, 3] points on the six faces of a box about the origin."""
    random = np.random.default_rng(1)
    points = random.random((count, 3), np.float32) * 2 - 1
    axis = random.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis])
    return points * np.array(half, np.float32)


def picture(camera: StartCamera, points: Floats, up: Point = UP) -> tuple[Floats, Floats]:
    """Tangents right and down [N, 2], and depths [N], of points as the camera sees them."""
    rotation = np.array(Pose.look_at(camera.position, camera.look_at, up).rotation)
    seen = (points - np.array(camera.position)) @ rotation
    return seen[:, :2] / seen[:, 2:], seen[:, 2]


@pytest.mark.parametrize("half", [(0.3, 1.0, 0.3), (1.0, 0.4, 1.0), (0.01, 0.02, 0.01), (0.5, 0.5, 2.0)])
@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (100.0, -20.0, 3.0)])
def test_an_object_fits_into_the_picture_seen_from_a_little_above(
    half: tuple[float, float, float], centre: tuple[float, float, float]
) -> None:
    points = on_box(half) + np.array(centre, np.float32)
    camera = derive(points)
    tangents, depth = picture(camera, points)
    assert depth.min() > 0
    assert np.abs(tangents[:, 1]).max() < math.tan(math.radians(30))
    assert np.abs(tangents[:, 0]).max() < math.tan(math.radians(30)) * 16 / 9
    assert np.abs(tangents).max() > 0.2  # and does not get lost in it
    assert camera.position[1] < centre[1]  # y points down


def test_stray_gaussians_do_not_push_the_camera_away() -> None:
    points = on_box((0.5, 0.5, 0.5))
    strays = normal(2, 100) * 50
    near, far = (derive(np.concatenate(parts)) for parts in ((points,), (points, strays)))
    assert math.dist(far.position, far.look_at) < 1.2 * math.dist(near.position, near.look_at)


def test_the_side_with_the_most_to_see_is_the_front() -> None:
    points = on_box((0.5, 0.5, 0.5))
    detail = np.random.default_rng(3).random((20_000, 3), np.float32) - 0.5
    detail[:, 0] = 0.5  # three times as many Gaussians on the face at +x
    camera = derive(np.concatenate((points, detail)))
    assert camera.position[0] > 1
    assert abs(camera.position[2]) < camera.position[0]


def test_without_a_better_side_the_camera_looks_along_z() -> None:
    ball = normal(4)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    camera = derive(ball)
    assert camera.position[2] < -1
    assert abs(camera.position[0]) < -0.6 * camera.position[2]


def test_any_up_will_do() -> None:
    upright = on_box((0.3, 1.0, 0.3))
    lying = upright[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0], np.float32)  # the former up axis is now +z
    camera = derive(lying, (0.0, 0.0, 2.0))
    assert camera.position[2] > 0.2
    tangents, depth = picture(camera, lying, (0.0, 0.0, 2.0))
    assert depth.min() > 0
    assert np.abs(tangents[:, 1]).max() < math.tan(math.radians(30))


@pytest.mark.parametrize(
    "means",
    [
        floats([0, 0, 0]),
        floats(*[[1e6, 1e6, 1e6]] * 3),
        floats([0, 0, 0], [1, 0, 0]),
        floats(*([0, y, 0] for y in np.linspace(0, 1, 100))),
        floats(*([x, x, x] for x in np.linspace(-1e9, 1e9, 100))),
        floats(*[[1e-30, 1e-30, 1e-30]] * 2),
    ],
    ids=["one point", "one place", "two points", "a vertical line", "enormous", "tiny"],
)
@pytest.mark.parametrize("opacity", [0.0, 0.001, 1.0])
def test_degenerate_scenes_get_a_camera_too(means: Floats, opacity: float) -> None:
    camera = derive_uniform(means, opacity, 0)
    assert all(map(math.isfinite, (*camera.position, *camera.look_at)))
    assert camera.position != camera.look_at
    Pose.look_at(camera.position, camera.look_at, UP)


@pytest.mark.parametrize("scale", [1e9, math.exp(88), 3e38])
def test_a_gaussian_larger_than_any_coordinate_does_not_push_the_camera_away(scale: float) -> None:
    camera = derive_uniform(normal(6, 9), 1, scale)
    assert camera.position != camera.look_at
