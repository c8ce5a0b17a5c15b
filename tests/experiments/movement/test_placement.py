"""Positions of movements in a scene, worked out by hand; see also `test_trace_golden.py`."""

from __future__ import annotations

import math

import pytest

from tests.scenes import scene
from tigas_common.pose import Pose
from tigas_common.wire.render import SceneInfo, StartCamera
from tigas_experiments.movement.placement import metre, placed
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.wire.movement import TimedPose

ONE_AHEAD = "t_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n20,0,-0.5,1,0,0,0,1\n"
EAST = scene(camera=StartCamera(position=(1, -2, 3), look_at=(9, -2, 3)))


def points(comments: str, where: SceneInfo = EAST) -> list[TimedPose]:
    return placed(MovementTrace.parse(comments + ONE_AHEAD, "walk.csv"), where)


def axes(point: TimedPose) -> Pose:
    x, y, z, w = point["quaternion"]
    return Pose.from_quaternion((0, 0, 0), (x, y, z, w))


def test_from_the_start_ahead_is_where_the_start_camera_looks() -> None:
    first, second = points("# anchor: start\n")
    assert first["position"] == pytest.approx([1, -2, 3])
    assert second["position"] == pytest.approx([2, -2.5, 3])
    assert [row[2] for row in axes(second).rotation] == pytest.approx([1, 0, 0])


def test_a_metre_is_a_quarter_of_the_way_to_what_the_start_camera_looks_at() -> None:
    assert metre(EAST) == 2
    assert points("# anchor: start\n# unit: m\n")[1]["position"] == pytest.approx([3, -3, 3])
    assert metre(scene()) == 1


def test_a_camera_that_looks_up_does_not_tilt_the_movement() -> None:
    steep = scene(camera=StartCamera(position=(0, 0, 0), look_at=(0, -3, 1)))
    assert points("# anchor: start\n", steep)[1]["position"] == pytest.approx([0, -0.5, 1])


def test_in_a_scene_with_z_up_the_floor_is_x_and_y() -> None:
    up = scene(up=(0, 0, 2), camera=StartCamera(position=(0, 0, 1.6), look_at=(0, 5, 1.6)))
    second = points("# anchor: start\n", up)[1]
    assert second["position"] == pytest.approx([0, 1, 2.1])
    rotation = axes(second).rotation
    assert [row[1] for row in rotation] == pytest.approx([0, 0, -1]), "the picture's down is the scene's"
    assert [row[2] for row in rotation] == pytest.approx([0, 1, 0])


def test_of_a_scene_itself_only_the_frame_changes() -> None:
    tilted = scene(up=(math.sin(0.2), -math.cos(0.2), 0), camera=EAST.camera)
    second = points("", tilted)[1]
    assert second["position"] == pytest.approx([0.5 * math.sin(0.2), -0.5 * math.cos(0.2), 1])
