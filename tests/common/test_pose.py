"""Poses follow DESIGN's axes: x right, y down, z forward, R = Ry(azimuth) · Rx(elevation) · Rz(roll)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tigas_common.pose import Intrinsics, Pose

ORIGIN = (0.0, 0.0, 0.0)
angles = st.floats(-720, 720)


def axis(pose: Pose, column: int) -> list[float]:
    """Where the camera's right (0), down (1) or forward (2) axis points in the scene."""
    return [row[column] for row in pose.rotation]


@pytest.mark.parametrize(
    ("azimuth", "elevation", "roll", "column", "expected"),
    [
        (0, 0, 0, 2, (0, 0, 1)),
        (90, 0, 0, 2, (1, 0, 0)),  # turns right: towards +x
        (0, 90, 0, 2, (0, -1, 0)),  # looks up: towards -y, for y points down
        (0, 0, 90, 0, (0, 1, 0)),  # rolls clockwise: the right axis sinks
        (90, 45, 0, 2, (math.sqrt(0.5), -math.sqrt(0.5), 0)),
    ],
)
def test_angles_turn_the_way_that_people_expect(
    azimuth: float, elevation: float, roll: float, column: int, expected: tuple[float, ...]
) -> None:
    pose = Pose.from_euler(azimuth, elevation, roll, ORIGIN)
    assert axis(pose, column) == pytest.approx(expected, abs=1e-12)


@given(angles, angles, angles)
def test_angles_are_the_product_of_three_rotations(azimuth: float, elevation: float, roll: float) -> None:
    a, e, r = np.radians([azimuth, elevation, roll])
    ry = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    rx = np.array([[1, 0, 0], [0, np.cos(e), -np.sin(e)], [0, np.sin(e), np.cos(e)]])
    rz = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    assert np.allclose(Pose.from_euler(azimuth, elevation, roll, ORIGIN).rotation, ry @ rx @ rz)


quaternions = st.tuples(*[st.floats(-1e9, 1e9)] * 4).filter(lambda q: max(map(abs, q)) > 1e-300)


@given(quaternions)
def test_any_quaternion_but_zero_is_a_rotation(quaternion: tuple[float, float, float, float]) -> None:
    rotation = np.array(Pose.from_quaternion(ORIGIN, quaternion).rotation)
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)


@given(quaternions)
def test_a_rotation_gives_its_quaternion_back(quaternion: tuple[float, float, float, float]) -> None:
    pose = Pose.from_quaternion(ORIGIN, quaternion)
    assert math.hypot(*pose.quaternion) == pytest.approx(1)
    assert np.allclose(Pose.from_quaternion(ORIGIN, pose.quaternion).rotation, pose.rotation, atol=1e-9)


def test_quaternion_and_angles_agree() -> None:
    half = math.radians(30) / 2
    turned = Pose.from_quaternion((1.0, 2.0, 3.0), (0.0, math.sin(half), 0.0, math.cos(half)))
    assert np.allclose(turned.rotation, Pose.from_euler(30, 0, 0, ORIGIN).rotation)
    assert turned.position == (1.0, 2.0, 3.0)
    with pytest.raises(ValueError, match="length zero"):
        Pose.from_quaternion(ORIGIN, (0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("up", [(0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 2.0, -0.5)])
def test_look_at_sees_the_target_with_up_upwards(up: tuple[float, float, float]) -> None:
    position, target = (1.0, -2.0, 5.0), (0.5, 0.0, 0.0)
    pose = Pose.look_at(position, target, up)
    direction = np.subtract(target, position)
    assert np.allclose(axis(pose, 2), direction / np.linalg.norm(direction))
    assert np.dot(axis(pose, 1), up) < 0
    assert np.dot(axis(pose, 0), up) == pytest.approx(0, abs=1e-12)


def test_look_at_copes_with_a_direction_along_up_and_refuses_no_direction() -> None:
    pose = Pose.look_at(ORIGIN, (0.0, 3.0, 0.0), (0.0, -1.0, 0.0))
    assert np.allclose(np.array(pose.rotation) @ np.array(pose.rotation).T, np.eye(3))
    with pytest.raises(ValueError, match="its own position"):
        Pose.look_at(ORIGIN, ORIGIN, (0.0, -1.0, 0.0))


def test_resizing_keeps_field_of_view_and_centre() -> None:
    small = Intrinsics(fx=900, fy=800, cx=600, cy=400, width=1200, height=800).resized(300, 400)
    assert small == Intrinsics(fx=225, fy=400, cx=150, cy=200, width=300, height=400)
