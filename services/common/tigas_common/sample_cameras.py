"""Sample cameras in a scene: random movements around its start camera and its subject."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from tigas_common.pose import Intrinsics, Pose, Vector3
from tigas_common.wire.model import Point
from tigas_common.wire.render import StartCamera

FOV_Y = 60.0
"""Vertical field of view of all views, in degrees."""
VIEWS_PER_MOVEMENT = 6
"""Views taken from each movement."""
NEAR, NEAR_DEGREES = 0.1, 15.0
"""Limits below which two views are neighbours: the distance between them, as a share of that from the start camera to
its subject, and the angle between their directions."""

Movement = Callable[[float], Pose]
"""The pose at a time from 0 to 1."""


def intrinsics(width: int, height: int) -> Intrinsics:
    """Intrinsics of all views, for a display of this size."""
    focal = height / 2 / math.tan(math.radians(FOV_Y / 2))
    return Intrinsics(focal, focal, width / 2, height / 2, width, height)


def sample_movement(movement: Movement, rng: Random) -> list[Pose]:
    """Views along one movement, from start to end."""
    return [movement((step + rng.random()) / VIEWS_PER_MOVEMENT) for step in range(VIEWS_PER_MOVEMENT)]


@dataclass(frozen=True, slots=True)
class SceneAxes:
    """The scene's level frame at its start camera; lengths are shares of `view`, the distance to the subject."""

    origin: Vector3
    subject: Vector3
    right: Vector3
    up: Vector3
    ahead: Vector3
    view: float

    @classmethod
    def from_camera(cls, camera: StartCamera, up: Point) -> SceneAxes:
        """Axes of a scene with this start camera and up direction, of any length."""
        origin, subject = camera.position, camera.look_at
        up = _scaled(1 / math.hypot(*up), up)
        to = _sum(subject, _scaled(-1, origin))
        level = _sum(to, _scaled(-_dot(to, up), up))
        if math.hypot(*level) < 1e-6 * math.hypot(*to):  # looking straight up or down
            level = (up[1], -up[0], 0.0) if abs(up[2]) < 0.9 else (0.0, up[2], -up[1])
        ahead = _scaled(1 / math.hypot(*level), level)
        return cls(origin, subject, _cross(ahead, up), up, ahead, math.hypot(*to))

    def walk(self, rng: Random) -> Movement:
        """Walk back and forth around the start camera, looking anywhere but mostly level."""
        aside, forward = _wave(rng, 0, 0.35), _wave(rng, 0.1, 0.35)
        height, pitch = _wave(rng, 0, 0.06), _wave(rng, 0, 12)
        yaw = _wave(rng, rng.uniform(-180, 180) if rng.random() < 0.5 else 0, 50)

        def at(time: float) -> Pose:
            turn, lift = math.radians(yaw(time)), math.radians(pitch(time))
            stand = self._offset(self.origin, aside(time), height(time), forward(time))
            level, rise = math.cos(lift), math.sin(lift)
            towards = self._offset(stand, level * math.sin(turn), rise, level * math.cos(turn))
            return Pose.look_at(stand, towards, self.up)

        return at

    def orbit(self, rng: Random) -> Movement:
        """Walk around the subject, facing it from varying distance and height."""
        start, way = rng.uniform(0, 2 * math.pi), rng.choice((-1, 1)) * rng.uniform(0.8, 2.5)
        distance, height = _wave(rng, 0.85, 0.3), _wave(rng, 0.08, 0.2)
        aside, above = _wave(rng, 0, 0.12), _wave(rng, 0, 0.12)

        def at(time: float) -> Pose:
            angle, radius = start + way * time, max(0.2, distance(time))
            stand = self._offset(self.subject, radius * math.sin(angle), height(time), radius * math.cos(angle))
            return Pose.look_at(stand, self._offset(self.subject, aside(time), above(time), 0), self.up)

        return at

    def are_neighbours(self, one: Pose, other: Pose) -> bool:
        """Whether two views show nearly the same thing from nearly the same place."""
        if math.dist(one.position, other.position) >= NEAR * self.view:
            return False
        cosine = sum(row[2] * theirs[2] for row, theirs in zip(one.rotation, other.rotation, strict=True))
        return cosine > math.cos(math.radians(NEAR_DEGREES))

    def _offset(self, point: Vector3, right: float, up: float, ahead: float) -> Vector3:
        way = _sum(_scaled(right, self.right), _sum(_scaled(up, self.up), _scaled(ahead, self.ahead)))
        return _sum(point, _scaled(self.view, way))


def _wave(rng: Random, middle: float, amplitude: float) -> Callable[[float], float]:
    """A slow sine around `middle`, random within an amplitude."""
    offset = rng.uniform(-amplitude, amplitude) / 2
    size, turns, phase = amplitude / 2, rng.uniform(0.3, 1.2), rng.random()
    return lambda time: middle + offset + size * math.sin(math.tau * (turns * time + phase))


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _scaled(factor: float, a: Vector3) -> Vector3:
    return (factor * a[0], factor * a[1], factor * a[2])


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector3, b: Vector3) -> Vector3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
