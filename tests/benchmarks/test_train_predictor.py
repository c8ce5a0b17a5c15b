"""Training of the page's linear predictor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.train_predictor import HORIZONS_MS, PAST_MS, STEP_MS, changes, main, moments, train
from tigas_experiments.movement.generated import generate
from tigas_experiments.movement.table import MovementError
from tigas_experiments.movement.trace import MovementTrace

AHEAD_MS = 300.0


def test_foresees_another_walk_of_the_kind_it_learned_from_better_than_constant_velocity() -> None:
    weights = train([generate("look-around", 20, seed) for seed in range(3)])
    way = generate("look-around", 20, 7)
    now = moments(way, 500, 500)
    truth = Rotation.from_quat(way.poses_at(now + AHEAD_MS)[1])
    before, here = (Rotation.from_quat(way.poses_at(times)[1]) for times in (now - STEP_MS, now))
    straight = here * Rotation.from_rotvec((before.inv() * here).as_rotvec() * AHEAD_MS / STEP_MS)
    learned = np.array(weights["turned"])[:, HORIZONS_MS.index(AHEAD_MS)]
    foreseen = here * Rotation.from_rotvec(np.einsum("nka,ak->na", changes(way, PAST_MS, now).turned, learned))
    error, going_on, none = ((guess.inv() * truth).magnitude().mean() for guess in (foreseen, straight, here))
    assert error < going_on / 2 < none / 4


def test_moments_keep_clear_of_the_ends_and_of_gaps() -> None:
    times = np.concatenate((np.arange(0, 1000, 20.0), np.arange(1500, 3000, 20.0)))
    way = MovementTrace(times, np.zeros((len(times), 3)), np.tile((0.0, 0, 0, 1), (len(times), 1)), "start", "m")
    now = moments(way, 160, 500)
    assert set(now) == {*np.arange(160, 481, 20.0), *np.arange(1660, 2481, 20.0)}


def test_a_movement_that_is_too_short_or_not_in_metres_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MovementError, match="too short"):
        train([generate("orbit", 0.3, 1)])
    path = tmp_path / "walk.csv"
    path.write_text("t_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n", encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["train_predictor", str(path), "--out", str(tmp_path / "out.json")])
    with pytest.raises(SystemExit, match=r"walk\.csv is not in metres"):
        main()
    assert not (tmp_path / "out.json").exists()
