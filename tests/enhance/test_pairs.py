"""Training pairs, and the service that renders them."""

from __future__ import annotations

import math
import subprocess
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests import scenes
from tests.prerequisites import SETPRIV
from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.render_requests import run_render_service
from tigas_common.sample_cameras import NEAR, NEAR_DEGREES
from tigas_common.wire.render import SceneInfo, StartCamera
from tigas_enhance.pairs import MAX_HELD_OUT, held_out_views, training_views


def scene(up: tuple[float, float, float] = (0.0, -1.0, 0.0), **changes: Any) -> SceneInfo:
    """Seen from ten units away, or some more."""
    across = (up[1], up[2], up[0])
    camera = StartCamera(position=(1.0, 2.0, 3.0), look_at=tuple(p + 10 * a for p, a in zip((1, 2, 3), across)))  # type: ignore[arg-type] # noqa: B905
    fields: dict[str, Any] = {"camera": camera, "id": "garden"}
    return scenes.scene(up, **(fields | changes))


def angle(one: Pose, other: Pose) -> float:
    """Degrees between the directions of two cameras."""
    cosine = sum(a[2] * b[2] for a, b in zip(one.rotation, other.rotation, strict=True))
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def test_no_training_view_is_a_neighbour_of_a_held_out_one() -> None:
    held_out = held_out_views(scene(), MAX_HELD_OUT)
    training = list(islice(training_views(scene()), 300))
    assert all(
        math.dist(one.position, other.position) >= 10 * NEAR or angle(one, other) >= NEAR_DEGREES
        for one in training
        for other in held_out
    )


def test_the_same_scene_has_the_same_views_and_fewer_are_the_first_of_more() -> None:
    assert held_out_views(scene(), 6) == held_out_views(scene(), 20)[:6]
    assert list(islice(training_views(scene()), 9)) == list(islice(training_views(scene()), 9))
    assert held_out_views(scene(id="other"), 6) != held_out_views(scene(), 6)


@pytest.mark.parametrize("up", [(0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 3.0, 4.0)])
def test_cameras_stand_upright_about_the_start_camera_and_its_subject(up: tuple[float, float, float]) -> None:
    place = scene(up)
    assert place.camera is not None
    length = math.hypot(*up)
    for pose in islice(training_views(place), 100):
        down = [row[1] for row in pose.rotation]
        assert -sum(d * u for d, u in zip(down, up, strict=True)) / length > 0.5
        reach = min(math.dist(pose.position, place.camera.position), math.dist(pose.position, place.camera.look_at))
        assert reach < 1.5 * math.dist(place.camera.position, place.camera.look_at)


def test_a_scene_without_a_start_camera_has_no_views() -> None:
    with pytest.raises(StartError, match="no start camera"):
        held_out_views(scene(camera=None), 1)


TRAINING = """
import time
from tigas_common.render_requests import run_render_service
with run_render_service("cpu") as url:
    print(url, flush=True)
    time.sleep(600)
"""


@pytest.mark.slow
@SETPRIV.mark
def test_it_ends_with_a_training_that_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", TRAINING], stdout=subprocess.PIPE) as training:
        assert training.stdout is not None
        try:
            assert training.stdout.readline().startswith(b"http://")
            services = psutil.Process(training.pid).children(recursive=True)
        finally:
            training.kill()
    assert services
    try:
        assert psutil.wait_procs(services, timeout=30)[1] == []
    finally:
        for service in services:
            if service.is_running():
                service.kill()


@pytest.mark.slow
def test_one_that_does_not_start_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TIGAS_RENDER_SCENES", str(tmp_path / "nowhere"))
    with (
        pytest.raises(StartError, match=r"^The render service did not start: .*nowhere"),
        run_render_service("cpu"),
    ):
        pass
