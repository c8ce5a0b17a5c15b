"""The poses of a run as the page plays them, and a digest that says whether two runs were given the same ones."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import TypedDict

import numpy as np

DECIMALS = 9
"""Of the digest: differences in the last bits, which mathematical libraries have, are no other movement."""


class Point(TypedDict):
    """A pose at a time, in the scene's own frame."""

    t_ms: float
    position: list[float]
    quaternion: list[float]


def digest(points: Sequence[Point]) -> str:
    """SHA-256 of the times (ms), positions and quaternions, in hexadecimal digits."""
    rows = np.array([[point["t_ms"], *point["position"], *point["quaternion"]] for point in points], dtype="<f8")
    # + 0.0: a negative zero is a zero
    return hashlib.sha256((np.round(rows, DECIMALS) + 0.0).tobytes()).hexdigest()
