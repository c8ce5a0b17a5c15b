"""Start views: inside of rooms and places, outside of objects, the same for the same file, and as scene.json says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.render.arrays import gaussians_of
from tests.render.scenes.start_view import captures
from tests.render.scenes.start_view.captures import Array
from tests.render.scenes.start_view.test_up_axis import TILTS, captured
from tigas_common.pose import Pose
from tigas_common.wire.render import StartCamera
from tigas_render.gaussians import Floats, Gaussians
from tigas_render.raster.base import Rasterizer
from tigas_render.raster.devices import create_rasterizer
from tigas_render.scenes.demo import DEMO_SOURCE
from tigas_render.scenes.source import SceneMetadata, SceneSource
from tigas_render.scenes.start_view.statistics import SceneStatistics
from tigas_render.scenes.start_view.view import StartView, StartViewCache
from tigas_render.server.preview import preview_camera

CAMERA = StartCamera(position=(1, 2, 3), look_at=(0, 0, 0))
WIDTH, HEIGHT = 160, 90
SOURCE = SceneSource("garden", SceneMetadata(), "1", None)
VIEW = StartView(up=(0, 0, 1), camera=StartCamera(position=(1, 2, 3), look_at=(0, 0, 0)))


@pytest.fixture(scope="module")
def rasterizer() -> Rasterizer:
    return create_rasterizer("cpu")


def view_of(scene: Gaussians) -> StartView:
    return SceneStatistics.of(scene).view(SceneMetadata())


def untilted(view: StartView, axis: Sequence[float], degrees: float) -> tuple[Array, Array]:
    """Position and direction of a view of a turned scene, before the turn."""
    back = captures.rotation(axis, degrees)[0].T
    position, focus = back @ view.camera.position, back @ view.camera.look_at
    return position, (focus - position) / np.linalg.norm(focus - position)


def covered(rasterizer: Rasterizer, scene: Gaussians, view: StartView) -> float:
    """Share of the picture that is not background, which is black; the scene is drawn in grey."""
    camera = preview_camera(view.camera, view.up, WIDTH, HEIGHT)
    grey = gaussians_of(scene.means, scene.scales, scene.quaternions, scene.opacities, 0 * scene.sh[:, :1])
    with rasterizer.render(rasterizer.prepare(grey), camera) as picture:
        return float((picture.to_host()[..., 0] > 64).mean())


@pytest.mark.parametrize(("axis", "degrees"), TILTS[::2])
def test_a_room_is_entered_at_eye_height(rasterizer: Rasterizer, axis: Sequence[float], degrees: float) -> None:
    scene, _ = captures.turned(captures.room(), axis, degrees)
    view = view_of(scene)
    (x, y, z), ahead = untilted(view, axis, degrees)
    assert abs(x) < 2.8
    assert abs(z) < 2.3
    assert -2.2 < y < -0.4
    assert abs(ahead[1]) < 0.2
    assert covered(rasterizer, scene, view) > 0.95


@pytest.mark.parametrize(("axis", "degrees"), TILTS[::2])
def test_an_outdoor_capture_is_seen_from_within(rasterizer: Rasterizer, axis: Sequence[float], degrees: float) -> None:
    scene, _ = captures.turned(captures.square(), axis, degrees)
    view = view_of(scene)
    (x, y, z), ahead = untilted(view, axis, degrees)
    assert max(abs(x), abs(z)) < 12
    assert -3 < y < -0.8
    assert abs(ahead[1]) < 0.2
    assert covered(rasterizer, scene, view) > 0.7  # the rest is sky


def test_the_courtyard_is_seen_from_within() -> None:
    (x, y, z) = view_of(DEMO_SOURCE.load()).camera.position
    assert max(abs(x), abs(z)) < 12
    assert -3 < y < -0.8


def test_a_flat_capture_is_seen_from_above(rasterizer: Rasterizer) -> None:
    scene = captures.field()
    camera = view_of(scene).camera
    to = np.array(camera.look_at) - camera.position
    assert math.degrees(math.asin(to[1] / np.linalg.norm(to))) == pytest.approx(32, abs=1)
    assert covered(rasterizer, scene, view_of(scene)) > 0.3


def test_an_object_is_seen_from_outside_and_fits(rasterizer: Rasterizer) -> None:
    scene = captures.statue()
    view = view_of(scene)
    assert math.hypot(view.camera.position[0], view.camera.position[2]) > 1.2
    pose = Pose.look_at(view.camera.position, view.camera.look_at, view.up)
    seen = (scene.means - np.array(view.camera.position)) @ np.array(pose.rotation)
    assert np.quantile(np.abs(seen[:, 1] / seen[:, 2]), 0.98) < math.tan(math.radians(30))
    assert 0.05 < covered(rasterizer, scene, view) < 0.6


@pytest.mark.parametrize(
    ("name", "front"),
    [("guitar", (1, 0)), ("flowers", (0, -1)), ("narcissus", (-1, -1)), ("playbot", (0, -1))],
)
def test_captured_objects_are_seen_from_their_front(name: str, front: tuple[float, float]) -> None:
    camera = view_of(captured(name)).camera
    x, z = camera.position[0] - camera.look_at[0], camera.position[2] - camera.look_at[2]
    assert (x * front[0] + z * front[1]) / (math.hypot(x, z) * math.hypot(*front)) > math.cos(math.radians(50))


def test_equal_scenes_have_equal_views_however_they_are_read() -> None:
    scene = captures.room()
    whole, parts = SceneStatistics(), SceneStatistics()
    for _ in whole.collect(scene.batches()).parts:
        pass
    blocks = (Gaussians(*(array[start : start + 4096] for array in scene.arrays)) for start in range(0, 30_000, 4096))
    for _ in parts.collect(type(scene.batches())(len(scene), (block for block in blocks if len(block)))).parts:
        pass
    assert whole.view(SceneMetadata()) == parts.view(SceneMetadata())


def test_a_camera_in_scene_json_is_the_view() -> None:
    statistics = SceneStatistics.of(captures.room())
    assert statistics.view(SceneMetadata(camera=CAMERA)) == StartView(up=(0, -1, 0), camera=CAMERA)
    assert statistics.view(SceneMetadata(camera=CAMERA, up=(0, 0, 2))) == StartView(up=(0, 0, 2), camera=CAMERA)


def test_an_up_axis_in_scene_json_is_kept_and_the_view_is_level_in_it() -> None:
    scene, _ = captures.turned(captures.statue(), (1, 0, 0), 180)
    view = SceneStatistics.of(scene).view(SceneMetadata(up=(0, 3, 0)))
    assert view.up == (0, 3, 0)
    assert view.camera.position[1] > view.camera.look_at[1]  # from a little above


def uniform(means: Floats, opacity: float = 0.9, scale: float = 0.01) -> Gaussians:
    n = len(means)
    return gaussians_of(means, np.full((n, 3), scale), np.zeros((n, 4)), np.full(n, opacity), np.zeros((n, 1, 3)))


def grid(*axes: Sequence[float]) -> Floats:
    return np.stack(np.meshgrid(*axes), -1).reshape(-1, len(axes)).astype(np.float32)


LINE, FLAT = np.linspace(-1, 1, 40).tolist(), [0.0]


@pytest.mark.parametrize(
    "means",
    [
        grid(FLAT, FLAT, FLAT),
        np.full((100, 3), 5, np.float32),
        np.full((3, 3), 1e9, np.float32),
        grid(FLAT, LINE, FLAT),
        grid(LINE, FLAT, FLAT),
        grid(LINE, FLAT, LINE),
        grid(LINE, LINE, FLAT),
        np.random.default_rng(0).uniform(-1e9, 1e9, (1000, 3)).astype(np.float32),
        np.random.default_rng(0).uniform(-1e-30, 1e-30, (1000, 3)).astype(np.float32),
    ],
    ids=["one", "one place", "far place", "upright line", "level line", "floor", "wall", "enormous", "tiny"],
)
@pytest.mark.parametrize("opacity", [0.0, 1.0])
@pytest.mark.parametrize("scale", [0.0, 0.01, 3e38])
def test_degenerate_scenes_have_a_view(means: Floats, opacity: float, scale: float) -> None:
    view = view_of(uniform(means, opacity, scale))
    assert all(map(math.isfinite, (*view.up, *view.camera.position, *view.camera.look_at)))
    assert view.camera.position != view.camera.look_at
    Pose.look_at(view.camera.position, view.camera.look_at, view.up)


def test_a_view_is_kept_for_its_file_and_its_up_axis(tmp_path: Path) -> None:
    views = StartViewCache(tmp_path / "cache")
    assert views.read(SOURCE) is None
    views.write(SOURCE, VIEW)
    assert StartViewCache(tmp_path / "cache").read(SOURCE) == VIEW
    assert views.read(replace(SOURCE, metadata=SceneMetadata(name="Another"))) == VIEW
    assert views.read(replace(SOURCE, version="2")) is None
    assert views.read(replace(SOURCE, metadata=SceneMetadata(up=(0, 1, 0)))) is None


def test_a_broken_file_is_no_view(tmp_path: Path) -> None:
    views = StartViewCache(tmp_path)
    views.write(SOURCE, VIEW)
    for path in tmp_path.iterdir():
        path.write_text('{"up": [0, 0, 1]}')
    assert views.read(SOURCE) is None


def test_a_directory_that_cannot_be_made_keeps_nothing(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file")
    views = StartViewCache(tmp_path / "cache")
    views.write(SOURCE, VIEW)
    assert views.read(SOURCE) is None
