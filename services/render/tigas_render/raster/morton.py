"""Z-order, which makes neighbours in space neighbours in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import torch

BITS = 20
"""Bits per axis; three axes fill 60 of 64 bits."""
MAX_SAMPLE = 100_000
"""Approximate number of points from which the grid's extent is estimated."""

Integers = TypeVar("Integers", NDArray[np.int64], "torch.Tensor")


def morton_codes(points: NDArray[np.floating[Any]]) -> NDArray[np.int64]:
    """The Z-order codes [N] of finite points [N, 3]."""
    codes = np.zeros(len(points), np.int64)
    if len(points):
        low, scale = morton_grid(points)
        for axis in range(3):
            places = (points[:, axis].astype(np.float64) - low[axis]) * scale + 0.25
            codes |= spread((places.clip(0, 1) * (2**BITS - 1)).astype(np.int64)) << axis
    return codes


def morton_grid(points: NDArray[np.floating[Any]]) -> tuple[NDArray[np.float64], float]:
    """`low` [3] and `scale` of the grid for N > 0 points [N, 3], in which a point is at (point - low) · scale + 1/4.

    Half of the grid's width spans the middle 98 % of the widest axis, so that a few distant points do not make it
    coarse.
    """
    some = points[:: max(1, len(points) // MAX_SAMPLE)].astype(np.float64)
    low, high = np.quantile(some, (0.01, 0.99), axis=0)
    return low, 0.5 / max(float((high - low).max()), 1e-30)


def spread(values: Integers) -> Integers:
    """Insert two zero bits between the lowest BITS bits of each value."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        values = (values | (values << shift)) & mask
    return values
