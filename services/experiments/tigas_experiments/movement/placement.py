"""Where a movement is in a scene: from its levelled frame to the scene's own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tigas_common.wire.render import SceneInfo
from tigas_experiments.movement.trace import MovementTrace, as_points
from tigas_experiments.wire.movement import VIEW_M, TimedPose


def placed(trace: MovementTrace, scene: SceneInfo) -> list[TimedPose]:
    """The poses of a movement in the scene's own frame and unit.

    With `anchor: start` it begins where the start camera stands, turned by its azimuth (not by its elevation: a
    movement looks level before it looks up or down); in a scene without one, at the origin.
    """
    to_scene = level(scene.up)
    positions, rotations = trace.positions, Rotation.from_quat(trace.quaternions)
    if trace.anchor == "start":
        origin, azimuth = _start(scene, to_scene)
        turn = Rotation.from_rotvec((0, azimuth, 0))
        scale = metre(scene) if trace.unit == "m" else 1.0
        positions, rotations = origin + scale * turn.apply(positions), turn * rotations
    return as_points(trace.times_ms, to_scene.apply(positions), (to_scene * rotations).as_quat())


def level(up: Sequence[float]) -> Rotation:
    """Shortest rotation from the levelled frame, where up is [0, -1, 0], to a scene's frame with this up axis."""
    towards = np.asarray(up) / (np.linalg.norm(up) or 1.0)
    axis = np.cross((0.0, -1.0, 0.0), towards)
    sine, cosine = float(np.linalg.norm(axis)), float(-towards[1])
    if sine < 1e-9:
        return Rotation.identity() if cosine >= 0 else Rotation.from_rotvec((math.pi, 0, 0))
    return Rotation.from_rotvec(axis / sine * math.atan2(sine, cosine))


def metre(scene: SceneInfo) -> float:
    """Scene units per metre: the start camera's subject is `VIEW_M` away. 1 without a camera."""
    if scene.camera is None:
        return 1.0
    return math.dist(scene.camera.position, scene.camera.look_at) / VIEW_M or 1.0


def _start(scene: SceneInfo, to_scene: Rotation) -> tuple[NDArray[np.float64], float]:
    """Position and azimuth in radians of the start camera, in the levelled frame."""
    if scene.camera is None:
        return np.zeros(3), 0.0
    position, target = to_scene.inv().apply((scene.camera.position, scene.camera.look_at))
    x, _, z = target - position
    return position, math.atan2(x, z)
