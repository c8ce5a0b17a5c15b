"""The `tigas` command with a CPU rasteriser that draws the directions of the world instead of a scene.

A test reads the view's heading from the pixels on a screen, independently of all reports: also of a picture that the
page has turned since it was rendered. The horizon is divided into 127 black and white cells in the order of a maximum
length sequence, in which any seven neighbours are unique. Cameras have to be level.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from tigas_common import cli
from tigas_common.pose import Pose
from tigas_render.raster.base import Camera, PreparedScene, Rasterizer
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.raster.host_image import HostImage

STAMPING = (sys.executable, "-m", "tests.web.stamping")
"""In place of `tigas`."""
FIRST = -0.1
"""The least heading that is found, in radians; the greatest is half a circle and as much."""
STEP = math.radians(0.1)
"""Between the headings that `read_headings` tells apart."""
TOLERANCE = math.radians(0.3)
"""Of a reading."""
ALIKE = 0.7
"""Correlation of a row of pixels with that of the best heading; less is not a reading."""
LEAST_SHOWN = 0.4
"""Share of a row that has to be shown for a reading: some nine cells."""

Floats = NDArray[np.float64]


def heading(pose: Pose) -> float:
    """Which way a camera looks about the vertical axis, in radians; to the right is more."""
    return math.atan2(pose.rotation[0][2], pose.rotation[2][2])


def read_headings(rows: Floats) -> list[float | None]:
    """The headings of rows of brightness [N, samples] across a screen, of cameras that turn by at most half a circle
    from straight ahead to the right; NaN where nothing is shown. None where the heading is unreadable. The lens is that
    which fits most of them best.
    """
    some = rows[:: max(1, len(rows) // 10)]
    half = max(np.arange(0.5, 1.6, 0.0125), key=lambda half: np.median(_likeness(some, half, 5 * STEP).max(1)))
    likeness = _likeness(rows, half, STEP)
    found = zip(likeness.argmax(1), likeness.max(1), strict=True)
    return [float(FIRST + STEP * number) if score >= ALIKE else None for number, score in found]


def _likeness(rows: Floats, half: float, step: float) -> Floats:
    """Correlations [N, headings] of the shown parts with the views of cameras that see, at unit distance, `half` to
    each side; 0 where too little is shown.
    """
    headings = np.arange(FIRST, math.pi - FIRST, step)
    edges = np.linspace(-half, half, 2 * rows.shape[1] + 1)
    fine = _cells(headings[:, None] + np.arctan(0.5 * (edges[1:] + edges[:-1])))
    expected = fine.reshape(len(headings), -1, 2).mean(2).T
    shown = (~np.isnan(rows)).astype(np.float64)
    count = shown.sum(1, keepdims=True)
    centred = np.nan_to_num(rows - np.nansum(rows, 1, keepdims=True) / np.maximum(count, 1))
    variance = (centred**2).sum(1, keepdims=True)
    expected_variance = shown @ expected**2 - (shown @ expected) ** 2 / np.maximum(count, 1)
    likeness: Floats = centred @ expected / np.sqrt(np.maximum(variance * expected_variance, 1e-9))
    return np.where(count < LEAST_SHOWN * rows.shape[1], 0, likeness)


class StampingRasterizer(CpuRasterizer):
    """Draws each column's direction over the scene."""

    def render(self, scene: PreparedScene, camera: Camera, *arguments: Any, **options: Any) -> HostImage:
        image = super().render(scene, camera, *arguments, **options)
        k = camera.intrinsics
        across = (np.arange(k.width) + 0.5 - k.cx) / k.fx
        image.to_host()[:] = (255 * _cells(heading(camera.pose) + np.arctan(across))).astype(np.uint8)[:, None]
        return image


def _sequence() -> Floats:
    """The maximum length sequence of x⁷ + x⁶ + 1."""
    bits = [1] * 7
    while len(bits) < 127:
        bits.append(bits[-7] ^ bits[-6])
    return np.array(bits, np.float64)


def _cells(directions: Floats) -> Floats:
    """0 or 1 for each direction."""
    cells: Floats = _sequence()[np.floor(directions / math.tau * 127).astype(int) % 127]
    return cells


def _create(device: str, cache: Path) -> Rasterizer:
    return StampingRasterizer()


if __name__ == "__main__":
    with patch("tigas_render.server.main.create_rasterizer", _create):
        cli.main()
