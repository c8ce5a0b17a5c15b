"""Movement traces: reading, repairs, refusals, interpolation, and their place in a scene.

The page's reader and placer are tested with the same golden file.
"""

from __future__ import annotations

import json
import math
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.experiments.movement.golden import FILE, MOVEMENTS, REFUSED, golden
from tests.scenes import scene
from tigas_common.pose import Pose
from tigas_common.wire.render import SceneInfo, StartCamera
from tigas_experiments.movement.table import MovementError
from tigas_experiments.movement.trace import MovementTrace, place_in_scene, units_per_metre
from tigas_experiments.wire.movement import TimedPose

KEPT: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n"
POSE = "0,1,2,3,0,0,0,1\n"
LATER = "20,1,2,3,0,0,0,1\n"


def parse(text: str) -> MovementTrace:
    return MovementTrace.parse(text, "walk.csv")


@pytest.mark.parametrize(("text", "note"), [
    (HEADER + POSE + LATER, None),
    (HEADER + POSE + "20,1,2,3,0.001,0,0,0.999\n", None),
    ("gaze," + HEADER.strip() + ",pupil\n1,0,1,2,3,0,0,0,1,2\n", "Unknown columns were ignored: gaze, pupil."),
    (HEADER + POSE + POSE + LATER, "Rows with the same time as the previous row were left out: 1."),
    (HEADER + POSE + "20,1,2,3,0,0,0,2\n", "Quaternions normalised to length 1: 1."),
    (HEADER + POSE + "1520,1,2,3,0,0,0,1\n", "One gap between poses, up to 1,520 ms long, will be played straight"),
    (HEADER + POSE + "220,1,2,3,0,0,0,1\n" + "420,1,2,3,0,0,0,1\n", "2 gaps between poses, up to 220 ms long"),
])  # fmt: skip
def test_what_is_repaired_is_said(text: str, note: str | None) -> None:
    trace = parse(text)
    assert (note or "") in " ".join(trace.notes)
    assert len(trace.notes) == (note is not None)
    np.testing.assert_allclose(np.linalg.norm(trace.quaternions, axis=1), 1, atol=1e-15)
    assert (np.diff(trace.times_ms) > 0).all()


@pytest.mark.parametrize(("text", "sentence"), [
    ("", "walk.csv is empty."),
    (HEADER, "walk.csv has no poses."),
    ("t_ms,x,y\n0,1,2\n", "walk.csv has no column 'z'; it needs t_ms, x, y, z, qx, qy, qz, qw."),
    (HEADER + POSE + "\n# remark\n20,1,2,nan,0,0,0,1\n",
     "walk.csv, line 5: the row has a value that is not finite, or far too large."),
    (HEADER + "0,1,2,three,0,0,0,1\n", "walk.csv, line 2: z is 'three', which is not a number."),
    (HEADER + "-1e308,1,2,3,0,0,0,1\n1e308,1,2,3,0,0,0,1\n",
     "walk.csv, line 2: the row has a value that is not finite, or far too large."),
    (HEADER + POSE + "20,1,2\n", "walk.csv, line 3: the row has 3 of 8 cells."),
    (HEADER + LATER + POSE, "walk.csv, line 3: the row is earlier than the previous one."),
    (HEADER + "0,1,2,3,0,0,0,0\n",
     "walk.csv, line 2: the row has a quaternion that is not a rotation: its length is not 1."),
    (HEADER + "0,1e7,2,3,0,0,0,1\n", "walk.csv, line 2: the row is farther away than 1,000,000."),
    ("# anchor: moon\n" + HEADER + POSE, "walk.csv: its anchor is 'moon', and not start or scene."),
    ("# unit: m\n" + HEADER + POSE,
     "walk.csv: `anchor: scene` is in the scene's own unit; only `anchor: start` may be in m."),
    (HEADER + "1" * 20_000, "walk.csv, line 2 is longer than 10,000 characters."),
    ("ViewIndex,FOV1\n0,1\n",
     "walk.csv is a recording of EyeNavGS; convert it with `tigas movement import`."),
])  # fmt: skip
def test_what_is_refused_is_named_with_its_line(text: str, sentence: str) -> None:
    with pytest.raises(MovementError) as refused:
        parse(text)
    assert str(refused.value) == sentence


NUMBERS = st.one_of(st.floats(), st.floats(-2, 2), st.integers(-1, 3), st.sampled_from(["", "x", "1_0", "0x1", '"1"']))
ROWS = st.lists(st.lists(NUMBERS, min_size=7, max_size=9).map(lambda cells: ",".join(map(str, cells))), max_size=6)
HEADS = st.sampled_from(
    ["", HEADER, "# anchor: start\n# unit: m\n" + HEADER, "#:\n" + HEADER, '"t_ms,x\n', "t_ms,x\r,y\n", HEADER * 2]
)


@given(head=HEADS, rows=ROWS, end=st.text(max_size=20))
def test_whatever_a_text_is_it_is_a_movement_or_refused(head: str, rows: list[str], end: str) -> None:
    try:
        trace = parse(head + "\n".join(rows) + end)
    except MovementError:
        return
    points = place_in_scene(trace, scene(up=(1, 2, 3)))
    assert np.isfinite([[*point["position"], *point["quaternion"]] for point in points]).all()
    assert trace.times_ms[0] == 0
    assert (np.diff(trace.times_ms) > 0).all()


@pytest.mark.parametrize(("data", "sentence"), [
    (b"\x89PNG\r\n\x1a\n\0\0", "is binary, not the text of a movement."),
    (HEADER.encode("utf-16"), "is binary, not the text of a movement."),
    (HEADER.encode() + b"0,1,2\0,3", "is binary, not the text of a movement."),
    (b"", "is empty."),
    (None, "cannot be read: No such file or directory."),
])  # fmt: skip
def test_a_file_that_is_none_is_named(tmp_path: Path, data: bytes | None, sentence: str) -> None:
    path = tmp_path / "walk.csv"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(MovementError) as refused:
        MovementTrace.read(path)
    assert str(path) in str(refused.value)
    assert sentence in str(refused.value)


def test_a_file_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    with path.open("wb") as file:
        file.truncate(256_000_001)
    with pytest.raises(MovementError, match="larger than 256 MB"):
        MovementTrace.read(path)


def test_the_mark_that_a_spreadsheet_puts_before_the_text_is_no_part_of_it(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("# anchor: start\r\n" + HEADER + POSE, encoding="utf-8-sig")
    assert MovementTrace.read(path).anchor == "start"


def long(count: int) -> str:
    return HEADER + "".join(f"{at},{at / 1000},0,0,0,0,0,1\n" for at in range(count))


def test_a_long_recording_is_read_and_the_row_that_is_broken_is_named() -> None:
    text = long(100_000)
    trace = parse(text)
    assert (len(trace.times_ms), trace.duration_ms) == (100_000, 99_999)
    with pytest.raises(MovementError, match="line 100002: x is 'far'"):
        parse(text + "100000,far,0,0,0,0,0,1\n")


def test_rows_take_little_more_memory_than_their_numbers() -> None:
    text = long(100_000)
    tracemalloc.start()
    parse(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400 * 100_000, "bytes, of which numbers are 64 a row"


def test_what_the_file_says_of_itself_is_kept_and_written_as_one_line_each() -> None:
    trace = parse(f"# description: a: b\n# by = nobody\n#seed:1\n{HEADER}{POSE}")
    assert trace.description == "a: b"
    assert dict(trace.comments) == {"description": "a: b", "seed": "1"}
    hostile = MovementTrace.parse(trace.to_csv(), "again")
    lines = type(hostile)(
        hostile.times_ms, hostile.positions, hostile.quaternions, "start", "m", {"note": "two\nlines\r0,0"}
    ).to_csv()
    assert lines.splitlines()[:4] == ["# anchor: start", "# unit: m", "# note: two lines 0,0", HEADER.strip()]


def test_between_poses_it_goes_straight_and_turns_along_the_arc_and_the_ends_hold() -> None:
    half = math.sqrt(0.5)
    trace = parse(f"{HEADER}100,0,0,0,0,0,0,1\n200,1,0,0,0,{half},0,{half}\n400,3,4,0,0,-{half},0,-{half}\n")
    positions, quaternions = trace.poses_at([-50, 0, 25, 100, 200, 300, 999, 100 / 3, 150])
    assert positions[:7, 0].tolist() == [0, 0, 0.25, 1, 2, 3, 3]
    assert math.degrees(2 * math.atan2(quaternions[7, 1], quaternions[7, 3])) == pytest.approx(30)
    # a rotation and its negative are the same: nothing turns
    assert np.abs(quaternions[8]) == pytest.approx([0, half, 0, half])
    alone = parse(HEADER + POSE)
    assert (alone.duration_ms, alone.poses_at([500])[0].tolist()) == (0, [[1, 2, 3]])


def test_a_part_keeps_what_leads_to_its_end() -> None:
    trace = parse(HEADER + "".join(f"{at},{at},0,0,0,0,0,1\n" for at in (0, 40, 80, 120)))
    for end, last in ((0, 0), (39, 40), (40, 40), (41, 80), (500, 120)):
        assert trace.slice(0, end).duration_ms == last
    part = trace.slice(50, 90)
    assert (part.times_ms.tolist(), part.positions[:, 0].tolist()) == ([0, 30, 70], [50, 80, 120])


ONE_AHEAD = "t_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n20,0,-0.5,1,0,0,0,1\n"
EAST = scene(camera=StartCamera(position=(1, -2, 3), look_at=(9, -2, 3)))


def points(comments: str, where: SceneInfo = EAST) -> list[TimedPose]:
    return place_in_scene(MovementTrace.parse(comments + ONE_AHEAD, "walk.csv"), where)


def test_from_the_start_ahead_is_where_the_start_camera_looks() -> None:
    first, second = points("# anchor: start\n")
    assert first["position"] == pytest.approx([1, -2, 3])
    assert second["position"] == pytest.approx([2, -2.5, 3])
    x, y, z, w = second["quaternion"]
    assert [row[2] for row in Pose.from_quaternion((0, 0, 0), (x, y, z, w)).rotation] == pytest.approx([1, 0, 0])


def test_a_metre_is_a_quarter_of_the_way_to_what_the_start_camera_looks_at() -> None:
    assert units_per_metre(EAST) == 2
    assert points("# anchor: start\n# unit: m\n")[1]["position"] == pytest.approx([3, -3, 3])
    assert units_per_metre(scene()) == 1


def test_each_movement_is_where_it_was_in_each_scene() -> None:
    now = golden()
    assert {key: KEPT[key] for key in ("movements", "refused", "scenes")} == {
        key: json.loads(json.dumps(now[key])) for key in ("movements", "refused", "scenes")
    }
    for kept, made in zip(KEPT["placed"], now["placed"], strict=True):
        assert (kept["movement"], kept["scene"]) == (made["movement"], made["scene"])
        assert [point["t_ms"] for point in kept["points"]] == [point["t_ms"] for point in made["points"]]
        for key in ("position", "quaternion"):
            expected, got = (np.array([point[key] for point in of["points"]]) for of in (kept, made))
            if key == "quaternion":  # its negative is the same rotation
                got *= np.sign((got * expected).sum(axis=1, keepdims=True))
            np.testing.assert_allclose(got, expected, atol=1e-12, err_msg=f"{kept['movement']} in {kept['scene']}")


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_movement_is_refused_with_one_sentence(name: str) -> None:
    with pytest.raises(MovementError, match=r"^walk\.csv[^\n]+\.$"):
        MovementTrace.parse(REFUSED[name], "walk.csv")


@pytest.mark.parametrize("name", MOVEMENTS)
def test_what_is_written_is_read_back(name: str) -> None:
    trace = MovementTrace.parse(MOVEMENTS[name], name)
    again = MovementTrace.parse(trace.to_csv(), name)
    assert again.to_csv() == trace.to_csv()
    np.testing.assert_allclose(again.positions, trace.positions, atol=1e-6)
    np.testing.assert_allclose(again.quaternions, trace.quaternions, atol=2e-6)
    assert (again.anchor, again.unit, again.comments) == (trace.anchor, trace.unit, trace.comments)
