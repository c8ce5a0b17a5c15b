"""Generated movements: reproducible, with stable names."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.command import tigas
from tigas_experiments.movement.generated import DESCRIPTIONS, KINDS, generate
from tigas_experiments.movement.summary import Pace, Summary
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.wire.movement import VIEW_M

KEPT = Path(__file__).parents[3] / "traces" / "movement"


@pytest.mark.parametrize("kind", KINDS)
def test_making_it_again_gives_the_file_in_the_repository_byte_for_byte(kind: str, tmp_path: Path) -> None:
    kept = KEPT / f"{kind}.csv"
    command = MovementTrace.read(kept).comments["command"].split()
    assert command == f"tigas movement make {kind} --seconds 60 --seed 1".split()
    made = tmp_path / kept.name
    assert tigas(*command[1:], made).exit_code == 0
    assert made.read_bytes() == kept.read_bytes()


def test_every_kind_is_kept_and_described() -> None:
    assert {path.stem for path in KEPT.glob("*.csv")} == set(KINDS) == set(DESCRIPTIONS)
    for path in KEPT.glob("*.csv"):
        trace = MovementTrace.read(path)
        assert (trace.anchor, trace.unit, trace.duration_ms, trace.notes) == ("start", "m", 60_000, ())
        assert trace.description
        assert path.stat().st_size < 300_000


@pytest.mark.parametrize("kind", KINDS)
def test_a_longer_one_begins_with_the_shorter_one_at_the_origin(kind: str) -> None:
    short, long = generate(kind, 7, 3), generate(kind, 90, 3)
    count = len(short.times_ms)
    np.testing.assert_array_equal(long.times_ms[:count], short.times_ms)
    np.testing.assert_array_equal(long.positions[:count], short.positions)
    np.testing.assert_array_equal(long.quaternions[:count], short.quaternions)
    np.testing.assert_allclose(short.positions[0], 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(short.quaternions[0]), [0, 0, 0, 1], atol=1e-12)
    assert short.duration_ms >= 7000


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_they_move_as_they_are_called(seed: int) -> None:
    stroll, look, quick, orbit = (Summary.from_trace(generate(kind, 120, seed)) for kind in KINDS)
    assert 15 < stroll.path < 60
    assert stroll.turning[100] < 90
    assert look.path < 10, "the camera moves while looking around"
    assert 15 < look.turning[50] < 60
    assert quick.turning[50] < 30, "mostly still"
    assert 200 < quick.turning[99] < 360
    assert 0.4 < orbit.speed < 0.9


def test_quick_turns_start_and_stop_smoothly() -> None:
    trace = generate("quick-turns", 60, 1)
    still = Pace.from_trace(trace).turning < 0.5
    assert 0.4 < still.mean() < 0.8
    rotations = Rotation.from_quat(trace.quaternions)
    speed = np.degrees((rotations[:-1].inv() * rotations[1:]).magnitude()) * 60
    assert np.abs(np.diff(speed)).max() < 100, "no jump in speed from one pose to the next"


def test_who_orbits_faces_the_middle() -> None:
    trace = generate("orbit", 60, 1)
    middle = np.array((0, 0, VIEW_M))
    away = middle - trace.positions
    distance = np.linalg.norm(away, axis=1)
    ahead = Rotation.from_quat(trace.quaternions).apply((0, 0, 1))
    np.testing.assert_allclose((ahead * away).sum(axis=1) / distance, 1, atol=1e-9)
    assert math.isclose(distance[0], VIEW_M)
    assert abs(distance - VIEW_M).max() < 0.6
