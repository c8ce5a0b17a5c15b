"""Start cameras: outside an object, inside a room, and never anything that is not a camera."""

from __future__ import annotations

import math

import pytest
import torch

from tests.shared_data import reference_scene_ply
from tigas_common.pose import Pose
from tigas_common.wire.model import Point
from tigas_common.wire.render import StartCamera
from tigas_render.scenes.ply import load_ply
from tigas_render.scenes.start_camera import derive_camera

UP: Point = (0.0, -1.0, 0.0)


def derive(means: torch.Tensor, up: Point = UP) -> StartCamera:
    return derive_camera(means, torch.full((len(means),), 0.9), torch.full((len(means), 3), 0.01), up)


def on_box(half: tuple[float, float, float], count: int = 20_000) -> torch.Tensor:
    """[N, 3] points on the six faces of a box about the origin."""
    random = torch.Generator().manual_seed(1)
    points = torch.rand(count, 3, generator=random) * 2 - 1
    axis = torch.randint(0, 3, (count,), generator=random)
    points[torch.arange(count), axis] = points[torch.arange(count), axis].sign()
    return points * torch.tensor(half)


def picture(camera: StartCamera, points: torch.Tensor, up: Point = UP) -> tuple[torch.Tensor, torch.Tensor]:
    """Tangents right and down [N, 2], and depths [N], of points as the camera sees them."""
    rotation = torch.tensor(Pose.look_at(camera.position, camera.look_at, up).rotation)
    seen = (points - torch.tensor(camera.position)) @ rotation
    return seen[:, :2] / seen[:, 2:], seen[:, 2]


@pytest.mark.parametrize("half", [(0.3, 1.0, 0.3), (1.0, 0.2, 1.0), (0.01, 0.02, 0.01), (0.5, 0.5, 2.0)])
@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (100.0, -20.0, 3.0)])
def test_an_object_fits_into_the_picture_seen_from_a_little_above(
    half: tuple[float, float, float], centre: tuple[float, float, float]
) -> None:
    points = on_box(half) + torch.tensor(centre)
    camera = derive(points)
    tangents, depth = picture(camera, points)
    assert depth.min() > 0
    assert tangents[:, 1].abs().max() < math.tan(math.radians(30))
    assert tangents[:, 0].abs().max() < math.tan(math.radians(30)) * 16 / 9
    assert tangents.abs().max() > 0.2  # and does not get lost in it
    assert camera.position[1] < centre[1]  # y points down


def test_stray_gaussians_do_not_push_the_camera_away() -> None:
    points = on_box((0.5, 0.5, 0.5))
    strays = torch.randn(100, 3, generator=torch.Generator().manual_seed(2)) * 50
    near, far = (derive(torch.cat(parts)) for parts in ((points,), (points, strays)))
    assert math.dist(far.position, far.look_at) < 1.2 * math.dist(near.position, near.look_at)


def test_the_side_with_the_most_to_see_is_the_front() -> None:
    points = on_box((0.5, 0.5, 0.5))
    detail = torch.rand(20_000, 3, generator=torch.Generator().manual_seed(3)) - 0.5
    detail[:, 0] = 0.5  # three times as many Gaussians on the face at +x
    camera = derive(torch.cat((points, detail)))
    assert camera.position[0] > 1
    assert abs(camera.position[2]) < camera.position[0]


def test_without_a_better_side_the_camera_looks_along_z() -> None:
    ball = torch.randn(20_000, 3, generator=torch.Generator().manual_seed(4))
    ball /= ball.norm(dim=1, keepdim=True)
    camera = derive(ball)
    assert camera.position[2] < -1
    assert abs(camera.position[0]) < 0.1


def test_a_room_is_seen_from_inside() -> None:
    points = on_box((4.0, 1.4, 3.0))
    camera = derive(points)
    assert all(abs(p) < h for p, h in zip(camera.position, (3.0, 1.0, 2.0), strict=True))
    assert camera.look_at[1] == pytest.approx(camera.position[1])


def test_a_landscape_with_far_background_is_seen_from_inside() -> None:
    ground = on_box((1.0, 0.02, 1.0))
    dome = torch.randn(20_000, 3, generator=torch.Generator().manual_seed(5))
    dome = 30 * dome / dome.norm(dim=1, keepdim=True)
    camera = derive(torch.cat((ground, dome)))
    assert math.hypot(*camera.position) < 30


def test_any_up_will_do() -> None:
    upright = on_box((0.3, 1.0, 0.3))
    lying = upright[:, [0, 2, 1]] * torch.tensor([1.0, 1.0, -1.0])  # what was up is now +z
    camera = derive(lying, (0.0, 0.0, 2.0))
    assert camera.position[2] > 0.2
    tangents, depth = picture(camera, lying, (0.0, 0.0, 2.0))
    assert depth.min() > 0
    assert tangents[:, 1].abs().max() < math.tan(math.radians(30))


@pytest.mark.parametrize(
    "means",
    [
        torch.zeros(1, 3),
        torch.full((3, 3), 1e6),
        torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        torch.linspace(0, 1, 100)[:, None] * torch.tensor([0.0, 1.0, 0.0]),
        torch.linspace(-1e9, 1e9, 100)[:, None] * torch.ones(3),
        torch.full((2, 3), 1e-30),
    ],
    ids=["one point", "one place", "two points", "a vertical line", "enormous", "tiny"],
)
@pytest.mark.parametrize("opacity", [0.0, 0.001, 1.0])
def test_degenerate_scenes_get_a_camera_too(means: torch.Tensor, opacity: float) -> None:
    camera = derive_camera(means, torch.full((len(means),), opacity), torch.zeros(len(means), 3), UP)
    assert all(map(math.isfinite, (*camera.position, *camera.look_at)))
    assert camera.position != camera.look_at
    Pose.look_at(camera.position, camera.look_at, UP)


@pytest.mark.parametrize("scale", [1e9, math.exp(88), 3e38])
def test_a_gaussian_larger_than_any_coordinate_does_not_push_the_camera_away(scale: float) -> None:
    camera = derive_camera(torch.randn(9, 3), torch.ones(9), torch.full((9, 3), scale), UP)
    assert camera.position != camera.look_at


@pytest.mark.parametrize(
    ("name", "front"),
    [("guitar", (1, 0)), ("flowers", (0, -1)), ("narcissus", (-1, -1)), ("playbot", (0, -1))],
)
def test_captured_objects_are_seen_from_their_front(name: str, front: tuple[float, float]) -> None:
    scene = load_ply(reference_scene_ply(name))
    camera = derive_camera(scene.means, scene.opacities, scene.scales, UP)
    x, z = camera.position[0] - camera.look_at[0], camera.position[2] - camera.look_at[2]
    assert (x * front[0] + z * front[1]) / (math.hypot(x, z) * math.hypot(*front)) > math.cos(math.radians(50))
