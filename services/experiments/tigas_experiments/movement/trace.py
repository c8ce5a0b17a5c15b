"""Movement traces: timed camera poses, their CSV format, and their placement in a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from tigas_common.wire.render import SceneInfo
from tigas_experiments.movement.table import Floats, MovementError, Table, read_text
from tigas_experiments.wire.movement import (
    ANCHORS,
    COLUMNS,
    MAX_COORDINATE,
    MAX_DURATION_MS,
    QUATERNION_LENGTHS,
    UNITS,
    VIEW_M,
    Anchor,
    TimedPose,
    Unit,
)

TOO_FAR = f"is farther away than {MAX_COORDINATE:,.0f}"
LENGTH_TOLERANCE = 0.01
"""Deviation of a quaternion's length from 1 above which a note is added."""
GAP_MS = 100.0
"""Step between poses above which it counts as a gap, as interpolation becomes noticeable."""

T = TypeVar("T", bound=str)


@dataclass(frozen=True, slots=True, eq=False)
class MovementTrace:
    """A movement in a levelled frame: y points down along gravity, x and z are horizontal."""

    times_ms: Floats
    """[N], increasing; the first is 0."""
    positions: Floats
    """[N, 3], centre of the camera."""
    quaternions: Floats
    """[N, 4], unit quaternions x, y, z, w, camera to world."""
    anchor: Anchor
    """`start`: relative to a scene's start camera, from the origin and looking along z. `scene`: absolute."""
    unit: Unit
    """Unit of the positions: metres, or the scene's own."""
    comments: Mapping[str, str] = field(default_factory=dict)
    """Other metadata from the file."""
    notes: tuple[str, ...] = ()
    """Repairs made while reading, one sentence each."""

    @classmethod
    def read(cls, path: Path) -> MovementTrace:
        """Read a trace file. Raises MovementError."""
        return cls.parse(read_text(path), str(path))

    @classmethod
    def parse(cls, text: str, name: str) -> MovementTrace:
        """Parse a trace, which messages call `name`. Raises MovementError."""
        table = Table(text, name)
        if "ViewIndex" in table.columns:
            raise MovementError(f"{name} is a recording of EyeNavGS; convert it with `tigas movement import`.")
        comments = dict(table.comments)
        anchor = _parse_choice(comments.pop("anchor", "scene"), ANCHORS, name, "anchor")
        unit = _parse_choice(comments.pop("unit", "scene"), UNITS, name, "unit")
        if (anchor, unit) == ("scene", "m"):
            raise MovementError(
                f"{name}: `anchor: scene` is in the scene's own unit; only `anchor: start` may be in m."
            )
        values = table.read_numbers(COLUMNS)
        notes = []
        if unknown := [column for column in table.columns if column not in COLUMNS]:
            notes.append(f"Unknown columns were ignored: {', '.join(unknown)[:200]}.")
        times = values[:, 0] - values[0, 0]
        steps = np.diff(times, prepend=-1.0)
        table.reject_rows(steps < 0, "is earlier than the previous one")
        table.reject_rows(times > MAX_DURATION_MS, "is more than a day after the first")
        table.reject_rows(np.abs(values[:, 1:4]).max(axis=1) > MAX_COORDINATE, TOO_FAR)
        quaternions, scaled = unit_quaternions(table, values[:, 4:])
        kept = steps != 0
        if same := int((~kept).sum()):
            notes.append(f"Rows with the same time as the previous row were left out: {same:,}.")
        trace = cls(times[kept], values[kept, 1:4], quaternions[kept], anchor, unit, comments)
        return replace(trace, notes=(*notes, *scaled, *trace.gap_notes()))

    def to_csv(self) -> str:
        """The trace as CSV, with microseconds for times and six decimals for everything else."""
        comments = {"anchor": self.anchor, "unit": self.unit, **self.comments}
        head = [f"# {key}: {' '.join(value.split())}" for key, value in comments.items()]
        # adding 0 turns −0 into 0
        times = (np.round(self.times_ms, 3) + 0.0).tolist()
        poses = (np.round(np.hstack((self.positions, self.quaternions)), 6) + 0.0).tolist()
        rows = (",".join(map(_cell, (at, *pose))) for at, pose in zip(times, poses, strict=True))
        return "\n".join((*head, ",".join(COLUMNS), *rows, ""))

    @property
    def duration_ms(self) -> float:
        return float(self.times_ms[-1])

    @property
    def description(self) -> str:
        return self.comments.get("description", "")

    @property
    def gaps_ms(self) -> Floats:
        steps = np.diff(self.times_ms)
        return steps[steps > GAP_MS]

    def gap_notes(self) -> list[str]:
        gaps = self.gaps_ms
        if not len(gaps):
            return []
        count = "One gap" if len(gaps) == 1 else f"{len(gaps):,} gaps"
        return [f"{count} between poses, up to {gaps.max():,.0f} ms long, will be played straight across."]

    def poses_at(self, times_ms: ArrayLike) -> tuple[Floats, Floats]:
        """Positions [M, 3] and quaternions [M, 4] at times [M], interpolated linearly and by slerp, and constant beyond
        the ends.
        """
        at = np.clip(np.asarray(times_ms, np.float64), self.times_ms[0], self.times_ms[-1])
        positions = np.column_stack([np.interp(at, self.times_ms, axis) for axis in self.positions.T])
        if len(self.times_ms) == 1:
            return positions, np.repeat(self.quaternions, len(at), axis=0)
        return positions, Slerp(self.times_ms, Rotation.from_quat(self.quaternions))(at).as_quat()

    def slice(self, from_ms: float, to_ms: float) -> MovementTrace:
        """Cut out a part: from `from_ms`, which becomes time 0, to the first pose at or after `to_ms`."""
        first, last = np.searchsorted(self.times_ms, from_ms, side="right"), np.searchsorted(self.times_ms, to_ms) + 1
        begin = (self.positions[:1], self.quaternions[:1]) if from_ms == 0 else self.poses_at([from_ms])  # exact
        return replace(
            self,
            times_ms=np.concatenate(([0.0], self.times_ms[first:last] - from_ms)),
            positions=np.concatenate((begin[0], self.positions[first:last])),
            quaternions=np.concatenate((begin[1], self.quaternions[first:last])),
        )


def unit_quaternions(table: Table, quaternions: Floats) -> tuple[Floats, list[str]]:
    """Unit quaternions [N, 4] for the rows of a table, and a note if some had to be scaled. Raises MovementError."""
    lengths = np.linalg.norm(quaternions, axis=1)
    low, high = QUATERNION_LENGTHS
    table.reject_rows(
        (lengths < low) | (lengths > high), "has a quaternion that is not a rotation: its length is not 1"
    )
    scaled = int((np.abs(lengths - 1) > LENGTH_TOLERANCE).sum())
    notes = [f"Quaternions normalised to length 1: {scaled:,}."] if scaled else []
    return quaternions / lengths[:, None], notes


def _cell(value: float) -> str:
    return f"{value:.6f}".rstrip("0").rstrip(".")


def _parse_choice(value: str, known: tuple[T, ...], name: str, key: str) -> T:
    for one in known:
        if value == one:
            return one
    raise MovementError(f"{name}: its {key} is {value[:30]!r}, and not {' or '.join(known)}.")


def place_in_scene(trace: MovementTrace, scene: SceneInfo) -> list[TimedPose]:
    """The poses of a movement in the scene's own frame and unit.

    With `anchor: start`, it begins at the start camera's position, turned by its azimuth but not by its elevation, as a
    movement starts out level. In a scene without a start camera, it begins at the origin.
    """
    to_scene = level_rotation(scene.up)
    positions, rotations = trace.positions, Rotation.from_quat(trace.quaternions)
    if trace.anchor == "start":
        origin, azimuth = _start_pose(scene, to_scene)
        turn = Rotation.from_rotvec((0, azimuth, 0))
        scale = units_per_metre(scene) if trace.unit == "m" else 1.0
        positions, rotations = origin + scale * turn.apply(positions), turn * rotations
    poses = to_scene.apply(positions).tolist(), (to_scene * rotations).as_quat().tolist()
    return [
        TimedPose(t_ms=at, position=position, quaternion=quaternion)
        for at, position, quaternion in zip(trace.times_ms.tolist(), *poses, strict=True)
    ]


def level_rotation(up: Sequence[float]) -> Rotation:
    """Shortest rotation from the levelled frame, in which up is [0, -1, 0], to a scene's frame with this up axis."""
    towards = np.asarray(up) / (np.linalg.norm(up) or 1.0)
    axis = np.cross((0.0, -1.0, 0.0), towards)
    sine, cosine = float(np.linalg.norm(axis)), float(-towards[1])
    if sine < 1e-9:
        return Rotation.identity() if cosine >= 0 else Rotation.from_rotvec((math.pi, 0, 0))
    return Rotation.from_rotvec(axis / sine * math.atan2(sine, cosine))


def units_per_metre(scene: SceneInfo) -> float:
    """Scene units per metre, with the start camera's subject `VIEW_M` away; 1 without a start camera."""
    if scene.camera is None:
        return 1.0
    return math.dist(scene.camera.position, scene.camera.look_at) / VIEW_M or 1.0


def _start_pose(scene: SceneInfo, to_scene: Rotation) -> tuple[Floats, float]:
    """Position and azimuth in radians of the start camera, in the levelled frame."""
    if scene.camera is None:
        return np.zeros(3), 0.0
    position, target = to_scene.inv().apply((scene.camera.position, scene.camera.look_at))
    x, _, z = target - position
    return position, math.atan2(x, z)
