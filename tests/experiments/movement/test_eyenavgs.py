"""Recordings of EyeNavGS: columns by name, axes, eyes, scene settings, and invalid recordings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.scenes import scene
from tests.shared_data import shared_file
from tigas_experiments.movement.eyenavgs import (
    SceneSettings,
    read_eyes,
    read_settings,
    scene_name,
    to_recorded_scene,
    to_start_anchor,
)
from tigas_experiments.movement.summary import Summary
from tigas_experiments.movement.table import MovementError
from tigas_experiments.movement.trace import MovementTrace, place_in_scene

NTHU = (
    "ViewIndex,FOV1,FOV2,FOV3,FOV4,PositionX,PositionY,PositionZ,QuaternionX,QuaternionY,QuaternionZ,QuaternionW,"
    "GazeQX,GazeQY,GazeQZ,GazeQW,GazePosX,GazePosY,GazePosZ,timestep"
)
RUTGERS = (
    "ViewIndex,FOV1,FOV2,FOV3,FOV4,PositionX,PositionY,PositionZ,QuaternionX,QuaternionY,QuaternionZ,QuaternionW,"
    "GazePosX,GazePosY,GazePosZ,GazeQX,GazeQY,GazeQZ,GazeQW,Timestamp"
)
SITES = pytest.mark.parametrize("header", [NTHU, RUTGERS])
Row = tuple[int, float, tuple[float, float, float], tuple[float, float, float, float]]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def write(path: Path, header: str, rows: list[Row]) -> Path:
    """A recording of (eye, time, position, quaternion)."""
    lines = [
        ",".join(map(str, (eye, -0.9, 0.7, -0.9, 0.7, *position, *quaternion, *[9] * 7, time)))
        for eye, time, position, quaternion in rows
    ]
    path.write_text("\n".join((header, *lines, "")))
    return path


def both(time: float, position: tuple[float, float, float], quaternion: tuple[float, float, float, float]) -> list[Row]:
    """Both eyes in one place, the right one 5 ms later."""
    return [(0, time, position, quaternion), (1, time + 5, position, quaternion)]


@SITES
def test_position_and_rotation_are_turned_to_opencv(header: str, tmp_path: Path) -> None:
    turned = Rotation.from_euler("YXZ", (40, -20, 15), degrees=True)
    x, y, z, w = turned.as_quat().tolist()
    way = read_eyes(write(tmp_path / "u_s.csv", header, both(100, (1, 2, 3), (x, y, z, w))), "left")
    assert way.times_ms[0] == 0
    np.testing.assert_allclose(way.positions[0], (1, -2, -3))
    ours = Rotation.from_quat(way.quaternions[0])
    flip = np.array((1, -1, -1))
    # theirs: x right, y up, −z ahead; ours: x right, y down, z ahead
    for our_axis, their_axis in (((1, 0, 0), (1, 0, 0)), ((0, 1, 0), (0, -1, 0)), ((0, 0, 1), (0, 0, -1))):
        np.testing.assert_allclose(ours.apply(our_axis), flip * turned.apply(their_axis), atol=1e-12)


@SITES
def test_each_eye_has_its_own_way_and_the_middle_is_between_them_at_the_same_time(header: str, tmp_path: Path) -> None:
    yaw = Rotation.from_rotvec((0, math.radians(60), 0)).as_quat().tolist()
    path = write(
        tmp_path / "u_s.csv",
        header,
        [
            (0, 0, (0, 0, 0), UPRIGHT),
            (1, 5, (10, 0, 0), UPRIGHT),
            (0, 20, (2, 0, 0), UPRIGHT),
            (1, 25, (12, 0, 0), tuple(yaw)),
            (0, 40, (4, 0, 0), UPRIGHT),
            (1, 45, (14, 0, 0), tuple(yaw)),
        ],
    )
    left, right, middle = (read_eyes(path, eye) for eye in ("left", "right", "middle"))
    assert left.positions[:, 0].tolist() == [0, 2, 4]
    assert right.positions[:, 0].tolist() == [10, 12, 14]
    assert middle.times_ms.tolist() == [0, 20], "the right eye began after the left one's first pose"
    # at 20 ms the right eye is three quarters of the way from its first pose to its second
    np.testing.assert_allclose(middle.positions[:, 0], [(2 + 11.5) / 2, (4 + 13.5) / 2])
    angles = np.degrees(Rotation.from_quat(middle.quaternions).magnitude())
    np.testing.assert_allclose(angles, [60 * 0.75 / 2, 60 / 2])


def test_a_walk_is_level_in_metres_and_begins_at_the_origin_looking_ahead(tmp_path: Path) -> None:
    level = Rotation.from_euler("xyz", (-30, 70, 50), degrees=True)  # turns the recording's frame level
    facing, scale = Rotation.from_euler("y", 130, degrees=True), 2.7
    nodding = facing * Rotation.from_euler("XZ", (-10, 5), degrees=True)
    ahead, up = facing.apply((0, 0, -1)), np.array((0.0, 1.0, 0.0))
    places = [np.array((5.0, -4.0, 3.0)), np.array((5.0, -4.0, 3.0)) + ahead + 0.25 * up]

    def recorded(time: float, place: np.ndarray, rotation: Rotation) -> list[Row]:
        x, y, z = (level.inv().apply(place) * scale).tolist()
        a, b, c, d = (level.inv() * rotation).as_quat().tolist()
        return both(time, (x, y, z), (a, b, c, d))

    path = write(tmp_path / "u_s.csv", NTHU, recorded(0, places[0], facing) + recorded(1000, places[1], nodding))
    x, y, z, w = level.as_quat().tolist()
    walk = to_start_anchor(read_eyes(path, "left"), SceneSettings(scale, (x, y, z, w)))
    assert (walk.anchor, walk.unit) == ("start", "m")
    np.testing.assert_allclose(walk.positions, [(0, 0, 0), (0, -0.25, 1)], atol=1e-12)
    np.testing.assert_allclose(np.abs(walk.quaternions[0]), (0, 0, 0, 1), atol=1e-12)
    # it nods by 10° downwards and leans to the left by 5°: kept, roll and all
    nod = Rotation.from_euler("YXZ", (0, -10, -5), degrees=True)
    np.testing.assert_allclose((Rotation.from_quat(walk.quaternions[1]) * nod.inv()).magnitude(), 0, atol=1e-9)


def test_in_its_own_scene_nothing_moves_but_the_frame_is_level(tmp_path: Path) -> None:
    path = write(tmp_path / "u_s.csv", NTHU, both(0, (1, 2, 3), UPRIGHT) + both(20, (1, 2, 3), UPRIGHT))
    way = read_eyes(path, "left")
    plain, upward = to_recorded_scene(way, (0, -1, 0)), to_recorded_scene(way, (0, 1, 0))
    assert plain.positions[0].tolist() == [1, -2, -3]
    np.testing.assert_allclose(upward.positions[0], (1, 2, 3), atol=1e-12)


def test_in_a_scene_that_is_not_level_it_comes_out_where_it_was_recorded(tmp_path: Path) -> None:
    up = (0.3, -0.8, 0.4)
    way = read_eyes(write(tmp_path / "u_s.csv", NTHU, both(0, (1, 2, 3), (0.5, 0.1, -0.3, 0.7))), "left")
    point = place_in_scene(to_recorded_scene(way, up), scene(up=up))[0]
    np.testing.assert_allclose(point["position"], (1, -2, -3), atol=1e-12)
    np.testing.assert_allclose(point["quaternion"], way.quaternions[0], atol=1e-12)


@pytest.mark.parametrize(("content", "sentence"), [
    ("", "is empty"),
    ("t_ms,x\n0,1\n", "is not a recording of EyeNavGS: it has no column timestep or Timestamp"),
    (NTHU.replace("QuaternionW", "Q4"), "has no column 'QuaternionW'"),
    (NTHU, "has no poses"),
])  # fmt: skip
def test_what_is_no_recording(tmp_path: Path, content: str, sentence: str) -> None:
    path = tmp_path / "u_s.csv"
    path.write_text(content)
    with pytest.raises(MovementError, match=sentence):
        read_eyes(path, "left")


@pytest.mark.parametrize(("rows", "sentence"), [
    ([(0, 0.0, (math.nan, 0.0, 0.0), UPRIGHT)], "line 2: the row has a value that is not finite, or far too large"),
    ([(0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))], "line 2: the row has a quaternion that is not a rotation"),
    ([(2, 0.0, (0.0, 0.0, 0.0), UPRIGHT)], "line 2: the row has a ViewIndex that is neither 0 nor 1"),
    ([(0, 0.0, (0.0, 2e6, 0.0), UPRIGHT)], "line 2: the row is farther away than 1,000,000"),
    ([(0, 0.0, (0.0, 0.0, 0.0), UPRIGHT)], "has no rows of the right eye"),
    ([(0, 0.0, (0.0, 0.0, 0.0), UPRIGHT), (1, 9.0, (0.0, 0.0, 0.0), UPRIGHT)], "no time at which both eyes"),
    ([(eye, -at, (0.0, 0.0, 0.0), UPRIGHT) for at in range(5) for eye in (0, 1)], "out of order: 4 of 5 rows"),
])  # fmt: skip
def test_what_cannot_be_imported(tmp_path: Path, rows: list[Row], sentence: str) -> None:
    with pytest.raises(MovementError, match=sentence):
        read_eyes(write(tmp_path / "u_s.csv", RUTGERS, rows), "middle")


def test_a_clock_that_stumbles_costs_its_rows_only(tmp_path: Path) -> None:
    rows = [row for at in range(300) for row in both(20 * at, (at, 0, 0), UPRIGHT)]
    rows[200] = (0, 20 * 99, (77, 0, 0), UPRIGHT)
    rows[300] = (0, 20 * 10, (77, 0, 0), UPRIGHT)
    way = read_eyes(write(tmp_path / "u_s.csv", RUTGERS, rows), "left")
    assert way.notes == ("Rows of the left eye that are not later than all before them were left out: 2.",)
    assert len(way.times_ms) == 298
    assert 77 not in way.positions[[99, 100, 148, 149], 0]


@pytest.mark.parametrize(("content", "sentence"), [
    ("Scene_Name,Quaternion,Scale\nroom,\"0,0,0,1\",2\n", "has no scene 'train'; it has 'room'"),
    ("Scene_Name,Quaternion,Scale\ntrain,\"0,0,1\",2\n", "no numeric Scale and Quaternion"),
    ("Scene_Name,Quaternion,Scale\ntrain,\"0,0,0,0\",2\n", "no numeric Scale and Quaternion"),
    ("Scene_Name,Quaternion,Scale\ntrain,\"0,0,0,1\",0\n", "no numeric Scale and Quaternion"),
    ("Scene_Name,Quaternion,Scale\ntrain,\"0,0,0,1\",nan\n", "no numeric Scale and Quaternion"),
    ("Scene_Name,Quaternion,Scale\ntrain\n", "no numeric Scale and Quaternion"),
    ("", "has no scene 'train'; it has none"),
    ("Scene_Name\n" + "x" * 200_000, "is not a table of scenes: field larger than field limit"),
])  # fmt: skip
def test_what_is_no_scene_setting(tmp_path: Path, content: str, sentence: str) -> None:
    path = tmp_path / "scene_setting.csv"
    path.write_text(content)
    with pytest.raises(MovementError, match=sentence):
        read_settings(path, "train")


RECORDINGS = pytest.mark.parametrize(("site", "name", "seconds"), [
    ("NTHU", "user3_train", 60),
    ("NTHU", "user19_room", 60),
    ("Rutgers", "user105_playroom", 48.6),
    ("Rutgers", "user107_drjohnson", 95.5),
])  # fmt: skip


@RECORDINGS
def test_in_a_recording_the_eyes_are_beside_one_another_and_the_walk_is_level(
    site: str, name: str, seconds: float
) -> None:
    path = shared_file("movement", site, f"{name}.csv")
    settings = read_settings(shared_file("movement", site, "scene_setting.csv"), scene_name(path))
    left, right, middle = (read_eyes(path, eye) for eye in ("left", "right", "middle"))
    # both at the right eye's times; the head's movement in between is in `left`'s interpolation
    shift = 7.0
    positions, quaternions = left.poses_at(right.times_ms + shift)
    beside = Rotation.from_quat(quaternions).inv().apply(right.positions - positions) / settings.scale
    x, y, z = np.median(beside, axis=0)
    assert 0.055 < x < 0.075, "metres between the eyes, to the right in the head's own frame"
    assert math.hypot(y, z) < 0.01
    walk = to_start_anchor(middle, settings)
    assert walk.duration_ms / 1000 == pytest.approx(seconds, abs=0.1)
    matrix = Rotation.from_quat(walk.quaternions).as_matrix()
    lean = np.degrees(np.arctan2(matrix[:, 1, 0], matrix[:, 1, 1]))
    assert abs(lean.mean()) < 5, "a head is upright on average"
    assert np.ptp(walk.positions[:, 1]) < 0.5, "the walk leaves the floor"
    summary = Summary.from_trace(walk)
    assert 0.1 < summary.speed < 1.5
    assert 10 < summary.turning[50] < 100
    assert MovementTrace.parse(walk.to_csv(), name).notes == ()
