"""The poses of a run, in the scene's own frame, from what its configuration names as movement."""

from __future__ import annotations

import csv
import math
import random
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tigas_common.errors import StartError
from tigas_common.wire import SceneInfo
from tigas_lab.configuration import Configuration
from tigas_lab.run import Point

STROLL = "stroll"
STEP_MS = 1000 / 60
MAX_ROWS = 2_000_000
Vector = NDArray[np.float64]


def movement_points(configuration: Configuration, scene: SceneInfo) -> list[Point]:
    """All poses, at least as long as the run. Raises StartError with one sentence."""
    if configuration.movement == STROLL:
        return placed_at_start(list(_stroll(configuration.duration_s, configuration.seed, _size(scene))), scene)
    points, anchored = _read(Path(configuration.movement))
    if points[-1][0] < configuration.duration_s * 1000:
        raise StartError(
            f"The movement {configuration.movement} lasts {points[-1][0] / 1000:.1f} s, less than a run's "
            f"{configuration.duration_s:g} s: choose a shorter --duration."
        )
    return placed_at_start(points, scene) if anchored else _levelled(points, level(scene), np.zeros(3))


Row = tuple[float, Vector, Rotation]
"""Time in ms, position and camera-to-world rotation, in a levelled frame: y down, x and z on the floor."""


def level(scene: SceneInfo) -> Rotation:
    """From the levelled frame to the scene's own: the shortest rotation from [0, -1, 0] to its up axis."""
    up = np.asarray(scene.up) / np.linalg.norm(scene.up)
    axis = np.cross((0.0, -1.0, 0.0), up)
    sine, cosine = float(np.linalg.norm(axis)), float(-up[1])
    if sine < 1e-9:
        return Rotation.identity() if cosine > 0 else Rotation.from_rotvec((math.pi, 0, 0))
    return Rotation.from_rotvec(axis / sine * math.atan2(sine, cosine))


def placed_at_start(rows: Sequence[Row], scene: SceneInfo) -> list[Point]:
    """A movement that begins at the origin, looking along z, begun at the scene's start camera instead."""
    to_scene = level(scene)
    if scene.camera is None:
        return _levelled(rows, to_scene, np.zeros(3))
    position, target = (to_scene.inv().apply(point) for point in (scene.camera.position, scene.camera.look_at))
    ahead = target - position
    turn = Rotation.from_rotvec((0, math.atan2(ahead[0], ahead[2]), 0))
    return _levelled([(at, turn.apply(place), turn * rotation) for at, place, rotation in rows], to_scene, position)


def _levelled(rows: Sequence[Row], to_scene: Rotation, origin: Vector) -> list[Point]:
    return [
        Point(
            t_ms=at,
            position=to_scene.apply(origin + place).tolist(),
            quaternion=(to_scene * rotation).as_quat().tolist(),
        )
        for at, place, rotation in rows
    ]


def _size(scene: SceneInfo) -> float:
    """How far away what one looks at is, in scene units."""
    if scene.camera is None:
        return 4.0
    return math.dist(scene.camera.position, scene.camera.look_at) or 4.0


def _stroll(duration_s: float, seed: int, size: float) -> Iterator[Row]:
    """A person who looks around while walking to and fro: sums of slow sines; the seed decides periods and phases."""
    chance = random.Random(seed)

    def wave(amplitude: float, periods: tuple[float, ...]) -> list[tuple[float, float, float]]:
        return [(amplitude / len(periods), period * chance.uniform(0.8, 1.2), chance.random()) for period in periods]

    turn, nod = wave(50, (5, 11)), wave(8, (4, 9))
    aside, ahead = wave(0.12 * size, (8, 13)), wave(0.2 * size, (9, 17))

    def at(waves: list[tuple[float, float, float]], t: float) -> float:
        # From 0: the movement begins where the camera stands.
        return sum(a * (math.sin(math.tau * (t / p + f)) - math.sin(math.tau * f)) for a, p, f in waves)

    for step in range(math.ceil(duration_s * 1000 / STEP_MS) + 1):
        t = step * STEP_MS / 1000
        # intrinsic: first the turn about the vertical, then the nod
        rotation = Rotation.from_euler("YX", (at(turn, t), at(nod, t)), degrees=True)
        yield step * STEP_MS, np.array((at(aside, t), 0.0, at(ahead, t))), rotation


def _read(path: Path) -> tuple[list[Row], bool]:
    """A movement trace, and whether it begins at the scene's start camera. Raises StartError."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = file.readlines(256_000_000)
    except (OSError, UnicodeDecodeError) as error:
        raise StartError(
            f"There is no movement {str(path)!r}: neither {STROLL!r} nor a readable file ({error})."
        ) from None
    comments = {line.strip() for line in lines if line.startswith("#")}
    rows: list[Row] = []
    for number, row in enumerate(csv.DictReader(line for line in lines if not line.startswith("#")), 1):
        try:
            at, *values = (float(row[name]) for name in ("t_ms", "x", "y", "z", "qx", "qy", "qz", "qw"))
            rotation = Rotation.from_quat(values[3:])
        except (KeyError, TypeError, ValueError):
            at, values, rotation = math.nan, [], Rotation.identity()
        if not all(map(math.isfinite, (at, *values))) or (rows and at <= rows[-1][0]) or number > MAX_ROWS:
            raise StartError(f"{path}, row {number}: a movement needs growing t_ms, and x, y, z, qx, qy, qz, qw.")
        rows.append((at, np.array(values[:3]), rotation))
    if not rows:
        raise StartError(f"{path} has no poses.")
    return [(at - rows[0][0], place, rotation) for at, place, rotation in rows], "# anchor: start" in comments
