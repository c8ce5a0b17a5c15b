"""The commands `tigas movement …`, as a user runs them."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from tests.command import Result, tigas
from tests.experiments.movement.test_eyenavgs import NTHU, UPRIGHT, both, write
from tigas_experiments.movement.trace import MovementTrace


def run(*arguments: object) -> Result:
    return tigas("movement", *arguments, columns=200)


def said(result: Result) -> str:
    return " ".join(result.output.split())


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    rows = [row for at in range(100) for row in both(20 * at, (0.02 * at, 2, 3), UPRIGHT)]
    return write(tmp_path / "user3_train.csv", NTHU, rows)


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    path = tmp_path / "scene_setting.csv"
    path.write_text('\ufeffScene_Name,Quaternion,Scale\ntrain,"0, 0, 0, 1",0.5\n', encoding="utf-8")
    return path


def test_make_writes_what_was_asked_for_and_replaces_nothing(tmp_path: Path) -> None:
    out = tmp_path / "turns.csv"
    assert run("make", "quick-turns", out, "--seconds", 5, "--seed", 7).exit_code == 0
    assert MovementTrace.read(out).comments["command"] == "tigas movement make quick-turns --seconds 5 --seed 7"
    result = run("make", "stroll", out)
    assert (result.exit_code, "exists; remove it first" in said(result)) == (1, True)
    assert MovementTrace.read(out).duration_ms == 5000
    assert run("make", "stroll", tmp_path / "stroll.csv").exit_code == 0
    assert MovementTrace.read(tmp_path / "stroll.csv").duration_ms == 60_000


def test_import_keeps_a_recording_in_its_own_scene(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    assert run("import", recording, out, "--eye", "left").exit_code == 0
    trace = MovementTrace.read(out)
    assert (trace.anchor, trace.unit, trace.positions[-1].tolist()) == ("scene", "scene", [1.98, -2, -3])
    assert "EyeNavGS" in trace.comments["source"]
    assert "Apache-2.0; changed by TIGAS: left eye" in trace.comments["licence"]
    out.unlink()
    assert run("import", recording, out, "--up", "0,1,0").exit_code == 0
    assert MovementTrace.read(out).positions[0, 1:].tolist() == [2, 3]


def test_import_makes_a_walk_of_a_recording(recording: Path, settings: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    assert run("import", recording, out, "--eye", "left", "--settings", settings).exit_code == 0
    walk = MovementTrace.read(out)
    assert (walk.anchor, walk.unit) == ("start", "m")
    assert walk.positions[[0, -1]].tolist() == [[0, 0, 0], [3.96, 0, 0]]
    out.unlink()
    assert run("import", recording, out, "--settings", settings, "--metre", 10).exit_code == 0
    scaled = MovementTrace.read(out)
    assert (scaled.anchor, scaled.unit) == ("start", "scene")
    assert scaled.positions[-1, 0] == pytest.approx(39.6, abs=0.5)


@pytest.mark.parametrize(("arguments", "sentence"), [
    (["--metre", "2"], "--metre needs --settings."),
    (["--settings", "0,0,0,0,1"], "the scene 'train' has no numeric Scale and Quaternion."),
    (["--settings", "0,0,0,1,1e-9"], "is farther away than 1,000,000."),
    (["--settings", "0,0,0,1,1", "--up", "0,0,1"], "--up cannot be combined with --settings."),
    (["--settings", "nowhere.csv"], "nowhere.csv cannot be read"),
    (["--up", "0,0,0"], "--up takes 3 numbers such as 0,0,1, not '0,0,0'."),
    (["--up", "1,2"], "--up takes 3 numbers"),
])  # fmt: skip
def test_options_that_make_no_sense_write_nothing(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], sentence: str
) -> None:
    """A value of --settings that is no file's name is the content of one: a quaternion and a scale."""
    monkeypatch.chdir(tmp_path)
    if arguments[0] == "--settings" and arguments[1] != "nowhere.csv":
        level, scale = arguments[1].rsplit(",", 1)
        Path(arguments[1]).write_text(f'Scene_Name,Quaternion,Scale\ntrain,"{level}",{scale}\n')
    result = run("import", recording, tmp_path / "out.csv", *arguments)
    assert result.exit_code == 1
    assert sentence in said(result)
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("value", ["nan", "0", "inf", "-1"])
def test_a_metre_is_a_positive_number(recording: Path, tmp_path: Path, value: str) -> None:
    result = run("import", recording, tmp_path / "out.csv", f"--metre={value}")
    assert (result.exit_code, result.stderr.startswith("--metre: ")) == (2, True)


def test_show_says_how_long_how_dense_how_far_and_how_fast(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    turns = [(at, 0.1 * at, *((0, 0, 0, 1) if at % 2 else (0, 0.130526, 0, 0.991445))) for at in range(11)]
    path.write_text(
        "# by: [red]nobody[/red]\nt_ms,x,y,z,qx,qy,qz,qw,gaze\n"
        + "".join(f"{at * 200},{x},0,0,{a},{b},{c},{d},1\n" for at, x, a, b, c, d in turns)
    )
    result = run("show", path, "--plot", tmp_path / "walk.svg")
    assert result.exit_code == 0, result.output
    for sentence in (
        "by [red]nobody[/red]",
        "begins where it is in the scene",
        "duration 2 s in 11 poses",
        "rate 5.0/s, longest step 200 ms",
        "gaps 10, together 2 s",
        "way 1.0 units, 0.50 units/s on average",
        "note Unknown columns were ignored: gaze.",
        "degrees/s 75 75 75 75 75",
    ):
        assert sentence in said(result)
    assert ElementTree.parse(tmp_path / "walk.svg").getroot().tag.endswith("svg")


def test_show_says_what_is_no_movement_or_picture(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("t_ms,x\n")
    result = run("show", path)
    assert (result.exit_code, "has no column 'y'" in said(result)) == (1, True)
    assert "the file name must end in .png, .svg, .pdf." in said(run("show", path, "--plot", tmp_path / "walk.doc"))


def test_a_pose_alone_can_be_shown(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("t_ms,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,1\n")
    result = run("show", path, "--plot", tmp_path / "walk.png")
    assert result.exit_code == 0, result.output
    assert "0 s in 1 poses" in said(result)


def test_make_knows_its_kinds(tmp_path: Path) -> None:
    result = run("make", "dance", tmp_path / "out.csv")
    assert (result.exit_code, "choose one of stroll, look-around, quick-turns, orbit." in said(result)) == (1, True)
    assert run("make", "stroll", tmp_path / "out.csv", "--seconds", 1e9).exit_code == 2
