"""Recordings of EyeNavGS (Ding et al. 2025, arXiv:2506.02380): people with a headset, walking through captured scenes.

Its two sites name and order their columns differently. Rows alternate between the eyes, each with its own time. A pose
is that of an eye, in a right-handed frame with y up and −z ahead, in the scene's unit and not levelled. Ours has
OpenCV's axes, y down and z ahead, so positions and rotations are both turned by 180° about x.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from tigas_experiments.movement.table import MovementError, Table, read_text
from tigas_experiments.movement.trace import (
    TOO_FAR,
    MovementTrace,
    level_rotation,
    unit_quaternions,
)
from tigas_experiments.wire.movement import MAX_COORDINATE, MAX_DURATION_MS

Eye = Literal["left", "right", "middle"]
VIEWS = {"left": 0, "right": 1}
TIMES = ("timestep", "Timestamp")
"""Time columns at NTHU and Rutgers, in milliseconds."""
POSE = ("PositionX", "PositionY", "PositionZ", "QuaternionX", "QuaternionY", "QuaternionZ", "QuaternionW")
FLIP = np.array((1.0, -1.0, -1.0))
"""Factors for positions and rotation axes that turn the frame by 180° about x."""
MAX_SKIPPED_SHARE = 0.01
SOURCE = "EyeNavGS (Ding et al. 2025, arXiv:2506.02380)"


@dataclass(frozen=True, slots=True)
class SceneSettings:
    """A scene's row in scene_setting.csv."""

    scale: float
    """Units of the scene per metre."""
    level: Sequence[float]
    """Quaternion x, y, z, w, of any length, that levels vectors in the recording's frame."""


def read_eyes(path: Path, eye: Eye) -> MovementTrace:
    """Path of one eye or of their midpoint, in OpenCV's axes and the scene's frame and unit. Raises MovementError."""
    table = Table(read_text(path), str(path))
    time = next((column for column in TIMES if column in table.columns), None)
    if time is None:
        raise MovementError(f"{path} is not a recording of EyeNavGS: it has no column {' or '.join(TIMES)}.")
    values = table.read_numbers(("ViewIndex", time, *POSE))
    views, times, positions = values[:, 0], values[:, 1], values[:, 2:5]
    table.reject_rows(~np.isin(views, list(VIEWS.values())), "has a ViewIndex that is neither 0 nor 1")
    table.reject_rows(np.abs(times - times[0]) > MAX_DURATION_MS, "is more than a day after the first")
    table.reject_rows(np.abs(positions).max(axis=1) > MAX_COORDINATE, TOO_FAR)
    quaternions, notes = unit_quaternions(table, values[:, 5:])
    quaternions[:, :3] *= FLIP
    traces = {}
    for side, view in VIEWS.items():
        if eye not in (side, "middle"):
            continue
        mine = views == view
        if not mine.any():
            raise MovementError(f"{path} has no rows of the {side} eye.")
        # Keep only rows later than all before them, as a clock may have stopped or gone back.
        latest = np.maximum.accumulate(times[mine])
        kept = np.diff(latest, prepend=-np.inf) > 0
        if left_out := int((~kept).sum()):
            if left_out > MAX_SKIPPED_SHARE * len(kept):
                raise MovementError(f"{path} is out of order: {left_out:,} of {len(kept):,} rows go back.")
            notes.append(f"Rows of the {side} eye that are not later than all before them were left out: {left_out:,}.")
        traces[side] = MovementTrace(
            times[mine][kept], positions[mine][kept] * FLIP, quaternions[mine][kept], "scene", "scene"
        )
    trace = _midpoint(traces["left"], traces["right"], str(path)) if eye == "middle" else traces[eye]
    return replace(trace, times_ms=trace.times_ms - trace.times_ms[0], notes=(*notes, *trace.gap_notes()))


def to_recorded_scene(trace: MovementTrace, up: Sequence[float]) -> MovementTrace:
    """The path in the levelled frame of its recorded scene, which has this up axis."""
    return _rotate(trace, level_rotation(up).inv())


def to_start_anchor(trace: MovementTrace, settings: SceneSettings) -> MovementTrace:
    """The path as a walk through any scene: levelled, in metres, starting at the origin with z ahead."""
    x, y, z, w = settings.level
    walk = _rotate(trace, Rotation.from_quat((x, -y, -z, w)))
    ahead = Rotation.from_quat(walk.quaternions[0]).apply((0, 0, 1))
    walk = _rotate(
        replace(walk, positions=(walk.positions - walk.positions[0]) / settings.scale),
        Rotation.from_rotvec((0, -math.atan2(ahead[0], ahead[2]), 0)),
    )
    return replace(walk, anchor="start", unit="m")


def read_settings(path: Path, scene: str) -> SceneSettings:
    """Read a scene's row in a site's scene_setting.csv. Raises MovementError."""
    try:
        rows = list(csv.DictReader(read_text(path).splitlines()))
    except csv.Error as error:
        raise MovementError(f"{path} is not a table of scenes: {error}.") from None
    row = next((row for row in rows if row.get("Scene_Name") == scene), None)
    if row is None:
        known = ", ".join(repr(row.get("Scene_Name"))[:30] for row in rows[:8])
        raise MovementError(f"{path} has no scene {scene!r}; it has {known or 'none'}.")
    try:
        scale, level = float(row["Scale"]), [float(part) for part in row["Quaternion"].split(",")]
        if 0 < scale < math.inf and 0 < math.hypot(*level) < math.inf and len(level) == 4:
            return SceneSettings(scale, level)
    except (KeyError, TypeError, ValueError, AttributeError):
        pass
    raise MovementError(f"{path}: the scene {scene!r} has no numeric Scale and Quaternion.")


def scene_name(path: Path) -> str:
    return path.stem.partition("_")[2]


def _midpoint(left: MovementTrace, right: MovementTrace, name: str) -> MovementTrace:
    """The midpoint of the eyes, at those times of the left one at which the right one was also recorded."""
    times = left.times_ms[(left.times_ms >= right.times_ms[0]) & (left.times_ms <= right.times_ms[-1])]
    if not len(times):
        raise MovementError(f"{name} has no time at which both eyes were recorded.")
    (left_at, left_turn), (right_at, right_turn) = left.poses_at(times), right.poses_at(times)
    first, second = Rotation.from_quat(left_turn), Rotation.from_quat(right_turn)
    middle = first * (first.inv() * second) ** 0.5
    return replace(left, times_ms=times, positions=(left_at + right_at) / 2, quaternions=middle.as_quat())


def _rotate(trace: MovementTrace, rotation: Rotation) -> MovementTrace:
    return replace(
        trace,
        positions=rotation.apply(trace.positions),
        quaternions=(rotation * Rotation.from_quat(trace.quaternions)).as_quat(),
    )
