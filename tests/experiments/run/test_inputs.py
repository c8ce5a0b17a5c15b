"""Movements named by a run's configuration, and the resulting poses."""

from __future__ import annotations

import hashlib
import math
from itertools import pairwise
from pathlib import Path

import pytest

from tests.experiments.made_up import configuration
from tests.scenes import scene
from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.wire.render import SceneInfo, StartCamera
from tigas_experiments.run.inputs import Inputs, points_sha256
from tigas_experiments.wire.movement import TimedPose
from tigas_experiments.wire.run import Configuration, Network

HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n"
KINDS = ("stroll", "look-around", "quick-turns", "orbit")


def movement_points(configuration: Configuration, scene: SceneInfo) -> list[TimedPose]:
    """Inputs of a configuration with files relative to here."""
    return Inputs(Path()).points(configuration, scene)


def direction(point: TimedPose) -> tuple[float, float, float]:
    x, y, z, w = point["quaternion"]
    rows = Pose.from_quaternion((0, 0, 0), (x, y, z, w)).rotation
    return rows[0][2], rows[1][2], rows[2][2]


@pytest.mark.parametrize("movement", KINDS)
@pytest.mark.parametrize(("up", "position", "look_at"), [
    ((0.0, -1.0, 0.0), (1.0, -2.0, -3.0), (1.0, -2.0, 0.0)),
    ((0.0, -1.0, 0.0), (1.0, -2.0, -3.0), (5.0, -2.0, -3.0)),
    ((0.0, 0.0, 1.0), (2.0, 0.0, 1.5), (0.0, 0.0, 1.5)),
    ((0.0, 1.0, 0.0), (0.0, 1.0, 4.0), (0.0, 1.0, 0.0)),
])  # fmt: skip
def test_a_generated_movement_begins_where_a_visitor_enters(
    up: tuple[float, float, float],
    position: tuple[float, float, float],
    look_at: tuple[float, float, float],
    movement: str,
) -> None:
    camera = StartCamera(position=position, look_at=look_at)
    first = movement_points(configuration(movement=movement), scene(up, camera))[0]
    assert first["position"] == pytest.approx(position, abs=1e-9)
    ahead = [b - a for a, b in zip(position, look_at, strict=True)]
    assert direction(first) == pytest.approx([value / math.hypot(*ahead) for value in ahead], abs=1e-9)


@pytest.mark.parametrize("movement", KINDS)
def test_the_seed_decides_the_movement(movement: str) -> None:
    one, again, other = (
        movement_points(configuration(movement=movement, seed=seed, duration_s=5.0), scene()) for seed in (1, 1, 2)
    )
    assert one == again
    assert one != other
    assert one[-1]["t_ms"] >= 5000
    steps = pairwise(one)
    assert max(math.dist(a["position"], b["position"]) for a, b in steps) < 0.1, "nobody jumps"


def test_a_movement_of_the_scene_itself_stays_where_it_is(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text(f"# anchor: scene\n{HEADER}50,1,2,3,0,0,0,2\n1100,4,5,6,0,1,0,0\n")
    points = movement_points(configuration(movement=str(path)), scene())
    assert points[0] == {"t_ms": 0, "position": [1, 2, 3], "quaternion": [0, 0, 0, 1]}
    assert points[1]["t_ms"] == 1050


def test_of_a_long_file_a_run_gets_what_it_plays(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text(HEADER + "".join(f"{at},{at},0,0,0,0,0,1\n" for at in range(0, 60_000, 30)))
    points = movement_points(configuration(movement=str(path), duration_s=1.0), scene())
    assert [points[-2]["t_ms"], points[-1]["t_ms"]] == [990, 1020], "the pose after the end is what the end leads to"


def test_a_movement_is_as_long_as_the_run(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text(HEADER + "0,1,2,3,0,0,0,1\n500,1,2,3,0,0,0,1\n")
    with pytest.raises(StartError, match=r"lasts 0\.5 s, less than a run's 1 s: choose a shorter duration\.$"):
        movement_points(configuration(movement=str(path)), scene())


@pytest.mark.parametrize("name", ["dance", "nowhere/walk.csv", ".", "/dev/zero", "", "a\0b"])
def test_what_is_no_movement(name: str) -> None:
    with pytest.raises(StartError, match=r"There is no movement .* neither a file nor one of stroll"):
        movement_points(configuration(movement=name), scene())


def test_files_lie_where_the_directory_says(tmp_path: Path) -> None:
    (tmp_path / "walks").mkdir()
    (tmp_path / "walks" / "a.csv").write_text(HEADER + "0,1,2,3,0,0,0,1\n2000,1,2,3,0,0,0,1\n")
    inputs = Inputs(tmp_path)
    assert inputs.points(configuration(movement="walks/a.csv"), scene())[0]["position"] == [1, 2, 3]
    bus = Network(trace="bus.csv", trace_file=Path("bus.csv"))
    assert inputs.network(bus).trace_file == tmp_path / "bus.csv"
    assert inputs.network(Network(trace="4g-bus")).trace_file is None


def test_a_digest_tells_whether_a_file_is_what_it_was(tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text("a")
    (tmp_path / "bus.csv").write_text("b")
    run = configuration(movement="walk.csv", network=Network(trace="bus.csv", trace_file=Path("bus.csv")))
    inputs = Inputs(tmp_path)
    first = inputs.digests(run)
    assert first.movement == hashlib.sha256(b"a").hexdigest()
    assert first.trace == hashlib.sha256(b"b").hexdigest()
    assert inputs.digests(run) == first
    (tmp_path / "walk.csv").write_text("another")
    assert inputs.digests(run).movement != first.movement
    assert inputs.digests(run).trace == first.trace
    named = inputs.digests(configuration(movement="stroll", network=Network(trace="4g-bus")))
    assert (named.movement, named.trace) == (None, None), "what is named is no file"


def test_a_file_that_is_gone_is_named(tmp_path: Path) -> None:
    gone = configuration(network=Network(trace="bus.csv", trace_file=Path("bus.csv")))
    with pytest.raises(StartError, match=r"bus\.csv cannot be read: No such file or directory\.$"):
        Inputs(tmp_path).digests(gone)


def test_runs_of_one_configuration_have_one_points_sha256() -> None:
    first, second = configuration(seed=1), configuration(seed=1, repeat=2, profile=3)
    one, again, repeated, other = (
        points_sha256(Inputs(Path()).points(each, scene())) for each in (first, first, second, configuration(seed=2))
    )
    assert one == again == repeated
    assert one != other
    assert len(one) == 64


def test_only_what_is_seen_counts() -> None:
    def moved(by: float) -> TimedPose:
        return TimedPose(t_ms=0.0, position=[by, 1.0, 2.0], quaternion=[0.0, 0.0, 0.0, 1.0])

    assert points_sha256([moved(0.0)]) == points_sha256([moved(-0.0)]) == points_sha256([moved(1e-15)])
    assert points_sha256([moved(0.0)]) != points_sha256([moved(1e-6)])


def test_a_run_may_begin_within_a_movement(tmp_path: Path) -> None:
    rows = "".join(f"{t},{t / 1000},0,0,0,0,0,1\n" for t in range(0, 10_001, 50))
    path = tmp_path / "walk.csv"
    path.write_text(HEADER + rows)
    run = configuration(movement=str(path), movement_offset_s=4.02, duration_s=2.0)
    points = movement_points(run, scene())
    assert (points[0]["t_ms"], points[0]["position"][0]) == pytest.approx((0, 4.02))
    assert (points[1]["t_ms"], points[1]["position"][0]) == pytest.approx((30, 4.05)), "the file's own poses after it"
    assert points[-1]["t_ms"] == pytest.approx(2030), "to the run's end or just after it"
    with pytest.raises(StartError, match=r"lasts 10.0 s, less than a run's 2 s, begun at 8.5 s"):
        movement_points(run.model_copy(update={"movement_offset_s": 8.5}), scene())


def test_a_generated_movement_may_be_begun_later_too() -> None:
    whole = movement_points(configuration(movement="stroll", duration_s=8.0), scene())
    part = movement_points(configuration(movement="stroll", movement_offset_s=5.0, duration_s=3.0), scene())
    at = next(index for index, point in enumerate(whole) if point["t_ms"] > 5000)
    assert part[1]["position"] == pytest.approx(whole[at]["position"])
    assert part[1]["t_ms"] == pytest.approx(whole[at]["t_ms"] - 5000)
