"""Seeded movement generators: equal arguments give equal movements, and a longer one extends a shorter one.

All are in metres, start at the origin looking along z, and do not depend on the scene; docs/experiments.md describes
their purposes. The subject of a scene's start camera is `VIEW_M` ahead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from random import Random

import numpy as np
from scipy.spatial.transform import Rotation

from tigas_experiments.movement.table import Floats
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.wire.movement import VIEW_M

RATE_HZ = 60
NECK_TO_EYES = (0.0, -0.075, 0.0805)
"""Offset in metres in the head's frame, y down, from Oculus's SDK: turning the head also moves the eyes."""
ORBIT_S = 40.0
"""Seconds per revolution, which is 0.6 m/s."""

Wave = Callable[[Floats], Floats]
Generator = Callable[[Floats, Random], tuple[Floats, Rotation]]
"""Computes positions [N, 3] and rotations [N] at times [N] in seconds, with a random generator."""


def generate(kind: str, duration_s: float, seed: int) -> MovementTrace:
    """A movement of one of `KINDS`, of at least this duration. Raises KeyError."""
    times = np.arange(math.ceil(duration_s * RATE_HZ) + 1) / RATE_HZ
    positions, rotations = KINDS[kind](times, Random(seed))
    comments = {
        "description": DESCRIPTIONS[kind],
        "command": f"tigas movement make {kind} --seconds {duration_s:g} --seed {seed}",
    }
    return MovementTrace(times * 1000, positions, rotations.as_quat(), "start", "m", comments)


def stroll(times: Floats, rng: Random) -> tuple[Floats, Rotation]:
    """Walking back and forth while looking around: sums of slow sines."""
    yaw, pitch = _wave(rng, 50, 5, 11), _wave(rng, 8, 4, 9)
    aside, ahead = _wave(rng, 0.12 * VIEW_M, 8, 13), _wave(rng, 0.2 * VIEW_M, 9, 17)
    positions = np.column_stack((aside(times), np.zeros_like(times), ahead(times)))
    return positions, _from_angles(yaw(times), pitch(times))


def look_around(times: Floats, rng: Random) -> tuple[Floats, Rotation]:
    """Standing and looking around, with slight tilts of the head."""
    yaw, pitch, roll = _wave(rng, 80, 7, 13), _wave(rng, 15, 5, 11), _wave(rng, 4, 6, 10)
    return _turn_on_neck(_from_angles(yaw(times), pitch(times), roll(times)))


def quick_turns(times: Floats, rng: Random) -> tuple[Floats, Rotation]:
    """Standing and turning abruptly between targets: pauses, then turns by 30° to 150°.

    A turn of A degrees takes 0.3 s + A / 300°/s and follows the minimum-jerk profile 10τ³ − 15τ⁴ + 6τ⁵ (Flash and
    Hogan, J. Neuroscience 5, 1985), with a peak of 1.875 times its mean: 140 to 350°/s.
    """
    begins, lasts, yaws, pitches = [0.0], [1.0], [0.0], [0.0]  # the initial pause is a turn by 0°
    end = 0.0
    while end <= times[-1]:
        begin = end + rng.uniform(0.5, 2)
        angle = rng.uniform(30, 150)
        begins.append(begin)
        lasts.append(0.3 + angle / 300)
        yaws.append(yaws[-1] + (angle if rng.random() < 0.5 else -angle))
        pitches.append(rng.uniform(-15, 15))
        end = begin + lasts[-1]
    turn = np.searchsorted(begins, times, side="right") - 1
    tau = np.clip((times - np.take(begins, turn)) / np.take(lasts, turn), 0, 1)
    share = tau**3 * (10 - 15 * tau + 6 * tau**2)
    yaw, pitch = (
        np.take(angles, np.maximum(turn - 1, 0)) * (1 - share) + np.take(angles, turn) * share
        for angles in (yaws, pitches)
    )
    return _turn_on_neck(_from_angles(yaw, pitch))


def orbit(times: Floats, rng: Random) -> tuple[Floats, Rotation]:
    """Walking around the start camera's subject and facing it, at varying distance and height."""
    turning = rng.choice((-1, 1)) * math.tau / (ORBIT_S * rng.uniform(0.8, 1.2))
    distance = VIEW_M + _wave(rng, 0.25, 9, 17)(times)
    lower = _wave(rng, 0.1, 7, 12)(times)
    yaw = turning * times
    positions = np.column_stack((-distance * np.sin(yaw), lower, VIEW_M - distance * np.cos(yaw)))
    return positions, _from_angles(np.degrees(yaw), np.degrees(np.arctan2(lower, distance)))


KINDS: Mapping[str, Generator] = {
    "stroll": stroll,
    "look-around": look_around,
    "quick-turns": quick_turns,
    "orbit": orbit,
}
DESCRIPTIONS = {
    "stroll": "Walks to and fro, looking around",
    "look-around": "Stands and looks about",
    "quick-turns": "Stands, and turns quickly from one thing to another",
    "orbit": "Walks round what the start camera looks at",
}


def _wave(rng: Random, amplitude: float, *periods_s: float) -> Wave:
    """A sum of slow sines that starts at 0, with random phases, and periods that vary randomly by a fifth."""
    parts = [(amplitude / len(periods_s), period * rng.uniform(0.8, 1.2), rng.random()) for period in periods_s]

    def at(times: Floats) -> Floats:
        total = np.zeros_like(times)
        for size, period, phase in parts:
            total += size * (np.sin(math.tau * (times / period + phase)) - math.sin(math.tau * phase))
        return total

    return at


def _from_angles(yaw: Floats, pitch: Floats, roll: Floats | None = None) -> Rotation:
    """R = Ry(yaw) · Rx(pitch) · Rz(roll) from degrees [N]: to the right, upwards, clockwise."""
    angles = np.column_stack((yaw, pitch, np.zeros_like(yaw) if roll is None else roll))
    return Rotation.from_euler("YXZ", angles, degrees=True)


def _turn_on_neck(rotations: Rotation) -> tuple[Floats, Rotation]:
    """Positions and rotations of the eyes of a head that turns on its neck."""
    return rotations.apply(NECK_TO_EYES) - np.array(NECK_TO_EYES), rotations
