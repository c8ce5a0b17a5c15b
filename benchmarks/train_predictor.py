"""Trains the page's linear predictor of poses on recorded movements, and writes its coefficients.

    python -m benchmarks.train_predictor MOVEMENT.csv … [--out web/packages/viewer/predict/coefficients.json]

Movements are in metres, as written by `tigas movement import --anchor start --settings …`; docs/adaptation.md lists the
recordings behind the shipped coefficients, and their accuracy on others. At each recorded pose the change ahead is a
weighted sum of the last changes (ridge regression), by axes of the head: independent of position and orientation, and
of the other axes. In use, positions may have any unit.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tigas_experiments.movement.table import Floats, MovementError
from tigas_experiments.movement.trace import GAP_MS, MovementTrace

OUT = Path("web/packages/viewer/predict/coefficients.json")
STEP_MS = 20.0
STEPS = 8
"""Of the last changes; in 160 ms is all that helped in any experiment."""
PAST_MS = tuple(-STEP_MS * step for step in range(1, STEPS + 1))
HORIZONS_MS = (20.0, 40.0, 60.0, 80.0, 100.0, 150.0, 200.0, 250.0, 300.0, 400.0, 500.0)
RIDGE = 1e-6
"""Relative to the mean square of the weighted values."""
DECIMALS = 4


Weights = dict[str, list[list[list[float]]]]
"""`turned` and `moved`: [axis][horizon][step]."""


@dataclass(frozen=True, slots=True)
class Changes:
    """How poses differ from the one of a moment, in that one's frame: rotation vectors (radians), and metres."""

    turned: Floats
    """[N, K, 3]"""
    moved: Floats
    """[N, K, 3]"""


def changes(way: MovementTrace, offsets_ms: Sequence[float], now_ms: Floats) -> Changes:
    """From the moments `now_ms` [N] to each of K offsets."""
    positions, quaternions = way.poses_at(now_ms)
    to_head = Rotation.from_quat(quaternions).inv()
    turned, moved = [], []
    for offset in offsets_ms:
        there, orientation = way.poses_at(now_ms + offset)
        turned.append((to_head * Rotation.from_quat(orientation)).as_rotvec())
        moved.append(to_head.apply(there - positions))
    return Changes(np.stack(turned, axis=1), np.stack(moved, axis=1))


def moments(way: MovementTrace, before_ms: float, after_ms: float) -> Floats:
    """The recorded times with this much around them and no gap."""
    times = way.times_ms
    now: Floats = times[(times - before_ms >= times[0]) & (times + after_ms <= times[-1])]
    gaps = np.flatnonzero(np.diff(times) > GAP_MS)
    for begin, end in zip(times[gaps], times[gaps + 1], strict=True):
        now = now[(now + after_ms <= begin) | (now - before_ms >= end)]
    return now


def train(ways: Sequence[MovementTrace]) -> Weights:
    """Weights by ridge regression. Raises MovementError."""
    now = [moments(way, STEP_MS * STEPS, HORIZONS_MS[-1]) for way in ways]
    if not any(len(times) for times in now):
        raise MovementError("The movements are too short to learn from.")
    known = [changes(way, PAST_MS, times) for way, times in zip(ways, now, strict=True)]
    ahead = [changes(way, HORIZONS_MS, times) for way, times in zip(ways, now, strict=True)]
    return {
        "turned": _weights([one.turned for one in known], [one.turned for one in ahead]),
        "moved": _weights([one.moved for one in known], [one.moved for one in ahead]),
    }


def _weights(known: Sequence[Floats], ahead: Sequence[Floats]) -> list[list[list[float]]]:
    inputs, targets = np.concatenate(known), np.concatenate(ahead)
    weights = []
    for axis in range(3):
        x, y = inputs[:, :, axis], targets[:, :, axis]
        square = x.T @ x
        size = RIDGE * max(np.trace(square) / STEPS, np.finfo(float).tiny)
        solved = np.linalg.solve(square + size * np.eye(STEPS), x.T @ y)
        weights.append(solved.T.round(DECIMALS).tolist())
    return weights


def _in_metres(path: Path) -> MovementTrace:
    way = MovementTrace.read(path)
    if way.unit != "m":
        raise MovementError(f"{path} is not in metres.")
    return way


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("movements", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    try:
        ways = [_in_metres(path) for path in options.movements]
        weights = train(ways)
    except MovementError as error:
        sys.exit(str(error))
    about = {
        "command": "python -m benchmarks.train_predictor MOVEMENT.csv ...",
        "movements": sorted(path.stem for path in options.movements),
        "step_ms": STEP_MS,
        "horizons_ms": HORIZONS_MS,
    }
    options.out.write_text(json.dumps(about | weights) + "\n", encoding="utf-8")
    print(f"{options.out}: from {sum(len(way.times_ms) for way in ways):,} poses of {len(ways)} movements")


if __name__ == "__main__":
    main()
