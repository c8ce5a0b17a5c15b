"""Made-up captures, of discs on surfaces; y points down, and the ground is at y = 0."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tests.render.arrays import gaussians_of
from tigas_render.gaussians import Gaussians

Array = NDArray[np.float64]
Rectangle = tuple[Sequence[float], Sequence[float], Sequence[float]]
"""A corner, and two sides that start there."""
FAR_GROUND = ((-60, -60, 60, -12), (-60, 12, 60, 60), (-60, -12, -12, 12), (12, -12, 60, 12))
"""x and z from and to, around the square."""


def discs(rectangles: Sequence[Rectangle], per_metre: float = 12.0, size: float = 0.06, seed: int = 0) -> Gaussians:
    """Thin discs all over rectangles; `per_metre`: along a side."""
    random = np.random.default_rng(seed)
    means, quaternions = [], []
    for corner, along, beside in rectangles:
        a, b = np.array(along, float), np.array(beside, float)
        count = max(4, round(np.linalg.norm(np.cross(a, b)) * per_metre**2))
        normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
        parts = random.random((count, 2))
        means.append(np.array(corner, float) + parts[:, :1] * a + parts[:, 1:] * b)
        quaternions.append(np.tile(_from_z_to(normal), (count, 1)))
    number = sum(map(len, means))
    scales = np.tile((size, size, size / 10), (number, 1))
    light = random.random((number, 1, 1)) * np.ones((1, 1, 3)) * 2 - 1
    return gaussians_of(np.concatenate(means), scales, np.concatenate(quaternions), np.full(number, 0.9), light)


def box(low: Sequence[float], high: Sequence[float], *, sides: str = "xXyYzZ") -> list[Rectangle]:
    """Faces of a box: at the low x, the high X and so on."""
    (x, y, z), (u, v, w) = low, high
    a, b, c = (u - x, 0, 0), (0, v - y, 0), (0, 0, w - z)
    faces: dict[str, Rectangle] = {
        "x": (low, b, c),
        "X": ((u, y, z), b, c),
        "y": (low, a, c),
        "Y": ((x, v, z), a, c),
        "z": (low, a, b),
        "Z": ((x, y, w), a, b),
    }
    return [faces[side] for side in sides]


def room() -> Gaussians:
    """A room of 6 m × 2.6 m × 5 m with a table, a cupboard and, as in real captures, a blurred surrounding."""
    inside = discs(
        [
            *box((-3, -2.6, -2.5), (3, 0, 2.5)),
            *box((0.4, -0.75, 0.2), (1.8, -0.7, 1.2)),
            *box((-2.9, -2.0, 1.2), (-2.4, 0, 2.4)),
            *box((-1.5, -0.45, -2.3), (0.5, 0, -1.6)),
        ]
    )
    return together(inside, discs(box((-4, -3.6, -3.5), (4, 1, 3.5)), 3, 0.4, seed=1))


def square() -> Gaussians:
    """An outdoor capture: ground, a few houses around it, and a distant background."""
    near = discs(
        [
            *box((-12, -0.01, -12), (12, 0, 12), sides="Y"),
            *box((-8, -4, -8), (-5, 0, -3), sides="xXyzZ"),
            *box((4, -5, 2), (8, 0, 7), sides="xXyzZ"),
            *box((-1, -1, -1), (1, 0, 1), sides="xXyzZ"),
        ],
        6,
        0.12,
    )
    ring = [((x, 0, z), (u - x, 0, 0), (0, 0, w - z)) for x, z, u, w in FAR_GROUND]
    return together(near, discs([*box((-60, -25, -60), (60, 0, 60), sides="xXzZ"), *ring], 0.5, 2, seed=1))


def field() -> Gaussians:
    """A flat capture from the air: ground with low houses."""
    houses = [box((x, -0.6, z), (x + 1, 0, z + 1), sides="xXyzZ") for x in (-7, -2, 5) for z in (-6, 1, 4)]
    return discs([*box((-10, -0.01, -10), (10, 0, 10), sides="Y"), *itertools.chain(*houses)], 8, 0.09)


def statue() -> Gaussians:
    """An object: a pedestal on a plate, with something on it that is farther in front, at -z."""
    parts = [
        *box((-0.8, -0.1, -0.8), (0.8, 0, 0.8)),
        *box((-0.3, -0.9, -0.3), (0.3, -0.1, 0.3)),
        *box((-0.2, -1.5, -0.4), (0.2, -0.9, 0.1)),
    ]
    return discs(parts, 60, 0.012)


def together(*parts: Gaussians) -> Gaussians:
    """All Gaussians, in an order without meaning."""
    columns = [np.concatenate(arrays) for arrays in zip(*(part.arrays for part in parts), strict=True)]
    order = np.random.default_rng(2).permutation(len(columns[0]))
    return Gaussians(*(column[order] for column in columns))


def rotation(axis: Sequence[float], degrees: float) -> tuple[Array, Array]:
    """A turn about an axis, as a matrix [3, 3] and a quaternion w, x, y, z (Rodrigues)."""
    x, y, z = unit = np.array(axis, float) / np.linalg.norm(axis)
    turn = math.radians(degrees)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(3) + math.sin(turn) * cross + (1 - math.cos(turn)) * cross @ cross
    return matrix, np.array([math.cos(turn / 2), *(math.sin(turn / 2) * unit)])


def turned(scene: Gaussians, axis: Sequence[float], degrees: float) -> tuple[Gaussians, Array]:
    """The scene turned about an axis through the origin, and what was up (-y) in it before."""
    matrix, (w, x, y, z) = rotation(axis, degrees)
    product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    quaternions = scene.quaternions @ product.T
    moved = gaussians_of(scene.means @ matrix.T, scene.scales, quaternions, scene.opacities, scene.sh)
    return moved, matrix @ np.array([0.0, -1.0, 0.0])


def _from_z_to(normal: Array) -> Array:
    """[4] a half turn about the middle of z and the normal."""
    middle = normal + np.array([0, 0, 1]) if normal[2] > -0.9 else np.array([1.0, 0, 0])
    return np.array([0, *(middle / np.linalg.norm(middle))])
