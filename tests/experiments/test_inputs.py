"""Where movements put the viewer, and what is no movement."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from tests.experiments.made_up import configuration
from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.wire import SceneInfo, StartCamera
from tigas_lab.inputs import movement_points
from tigas_lab.run import Point

HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n"


def scene(up: tuple[float, float, float] = (0, -1, 0), camera: StartCamera | None = None) -> SceneInfo:
    """One that nobody has to load."""
    return SceneInfo(
        id="s",
        name="s",
        state="loaded",
        error=None,
        gaussians=1,
        sh_degree=0,
        file_bytes=1,
        memory_bytes=1,
        preview="",
        up=up,
        camera=camera,
        background=(0, 0, 0),
    )


def direction(point: Point) -> tuple[float, float, float]:
    """Where it looks."""
    x, y, z, w = point["quaternion"]
    rows = Pose.from_quaternion((0, 0, 0), (x, y, z, w)).rotation
    return rows[0][2], rows[1][2], rows[2][2]


@pytest.mark.parametrize(("up", "position", "look_at"), [
    ((0.0, -1.0, 0.0), (1.0, -2.0, -3.0), (1.0, -2.0, 0.0)),
    ((0.0, -1.0, 0.0), (1.0, -2.0, -3.0), (5.0, -2.0, -3.0)),
    ((0.0, 0.0, 1.0), (2.0, 0.0, 1.5), (0.0, 0.0, 1.5)),
    ((0.0, 1.0, 0.0), (0.0, 1.0, 4.0), (0.0, 1.0, 0.0)),
])  # fmt: skip
def test_a_generated_movement_begins_where_a_visitor_enters(
    up: tuple[float, float, float], position: tuple[float, float, float], look_at: tuple[float, float, float]
) -> None:
    camera = StartCamera(position=position, look_at=look_at)
    first = movement_points(configuration(), scene(up, camera))[0]
    assert first["position"] == pytest.approx(position, abs=1e-9)
    ahead = [b - a for a, b in zip(position, look_at, strict=True)]
    assert direction(first) == pytest.approx([value / math.hypot(*ahead) for value in ahead], abs=1e-9)


def test_the_seed_decides_the_movement() -> None:
    one, again, other = (movement_points(configuration(seed=seed), scene()) for seed in (1, 1, 2))
    assert one == again
    assert one != other
    assert one[-1]["t_ms"] >= 1000
    steps = pairwise(one)
    assert max(math.dist(a["position"], b["position"]) for a, b in steps) < 0.1, "nobody jumps"


def test_a_movement_of_the_scene_itself_stays_where_it_is(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text(f"# anchor: scene\n{HEADER}50,1,2,3,0,0,0,2\n1100,4,5,6,0,1,0,0\n")
    points = movement_points(configuration(movement=str(path)), scene())
    assert points[0] == {"t_ms": 0, "position": [1, 2, 3], "quaternion": [0, 0, 0, 1]}
    assert points[1]["t_ms"] == 1050


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("", "no poses"),
        (HEADER, "no poses"),
        (HEADER + "0,1,2,3,0,0,0,1\n0,1,2,3,0,0,0,1\n", "row 2"),
        (HEADER + "0,1,2,nan,0,0,0,1\n", "row 1"),
        (HEADER + "0,1,2,3,0,0,0,0\n", "row 1"),
        (HEADER + "0,1,2\n", "row 1"),
        ("time,x\n0,1\n", "row 1"),
        (HEADER + "0,1,2,3,0,0,0,1\n500,1,2,3,0,0,0,1\n", "lasts 0.5 s, less than a run's 1 s"),
        (None, "There is no movement"),
    ],
)
def test_what_is_no_movement(tmp_path: Path, content: str | None, sentence: str) -> None:
    path = tmp_path / "walk.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(StartError, match=sentence):
        movement_points(configuration(movement=str(path)), scene())
