"""The `tigas` command with a CPU rasteriser that encodes the camera's heading in each picture.

A test reads the pose of the pixels on a screen, independently of all reports. One row of 32 square cells along the
upper edge: white, black, white, black; the heading's 24 bits, the most significant first, white for 1; and 4 bits of
checksum, the exclusive or of the heading's six groups of four bits. Cells are a thirty-second of the picture's width,
at any resolution, and so survive the lowest quality and any scaling.
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
CELLS = 32
BITS = 24
ROUNDING = 2
"""Maximum difference between headings of one pose after conversions."""
_FINDER = [1, 0, 1, 0]
_BACK = 0.5
"""Radians: a camera that begins straight ahead and turns by half a circle to the right passes no end of the numbers."""


def heading(pose: Pose) -> int:
    """Which way a camera looks about the vertical axis, as a number of 24 bits that grows to the right."""
    angle = math.atan2(pose.rotation[0][2], pose.rotation[2][2])
    return round((angle + _BACK) % (2 * math.pi) / (2 * math.pi) * (1 << BITS)) % (1 << BITS)


def read_stamp(pixels: NDArray[np.uint8]) -> int | None:
    """The heading in RGB pixels, uint8 [H, W, 3], of any size; None if it is unreadable."""
    side = pixels.shape[1] / CELLS
    centres = ((np.arange(CELLS) + 0.5) * side).astype(int)
    cells = [int(pixels[int(side / 2), centre].mean() > 127) for centre in centres]
    number = int("".join(map(str, cells[len(_FINDER) : len(_FINDER) + BITS])), 2)
    return number if cells == _cells(number) else None


class StampingRasterizer(CpuRasterizer):
    """Draws each view's heading over it."""

    def render(self, scene: PreparedScene, camera: Camera, *arguments: Any, **options: Any) -> HostImage:
        image = super().render(scene, camera, *arguments, **options)
        _draw(image.to_host(), heading(camera.pose))
        return image


def _draw(pixels: NDArray[np.uint8], number: int) -> None:
    edges = np.round(np.arange(CELLS + 1) * pixels.shape[1] / CELLS).astype(int)
    row = np.zeros((pixels.shape[1], 1), np.uint8)
    for left, right, cell in zip(edges, edges[1:], _cells(number), strict=False):
        row[left:right] = 255 * cell
    pixels[: edges[1]] = row


def _cells(number: int) -> list[int]:
    checksum = 0
    for shift in range(0, BITS, 4):
        checksum ^= number >> shift & 0xF
    return [*_FINDER, *_bits(number, BITS), *_bits(checksum, 4)]


def _bits(value: int, count: int) -> list[int]:
    return [value >> place & 1 for place in reversed(range(count))]


def _create(device: str, cache: Path) -> Rasterizer:
    return StampingRasterizer()


if __name__ == "__main__":
    with patch("tigas_render.server.main.create_rasterizer", _create):
        cli.main()
