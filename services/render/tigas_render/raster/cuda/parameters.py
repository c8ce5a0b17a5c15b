"""One frame's parameters as the kernels take them: its tiles, and `struct Frame` of frame.cuh."""

from __future__ import annotations

import ctypes
import struct
from dataclasses import dataclass
from typing import Final, Literal

from tigas_common.wire.render import FrameFormat
from tigas_render.raster.base import Camera, derivative_limits, footprint
from tigas_render.raster.cuda.scene import CHUNK, CudaScene

SMALL_PICTURE = 640 * 360
"""Pixels. A picture of at most so many gets small tiles, as large ones would keep few multiprocessors busy; so does one
with more Gaussians than pixels, as those are small themselves. See docs/architecture.md."""

MAX_SLICES = 256
"""A slice's number has 8 bits."""
MAX_LISTS = 1 << 18
"""Lists of all tiles and slices together: enough to keep each short, few enough to count in microseconds."""
LAYOUT: Final = struct.Struct("=22Q6I4i27f4x")
"""Pointers; padded, chunks, capacity, tiles, tiles_x, slices; width, height, format, sh_coefficients; the floats."""
PixelFormat = FrameFormat | Literal["depth"]
FORMATS: Final[dict[PixelFormat, int]] = {"png": 0, "jpeg": 1, "yuv420p": 2, "depth": 3}
"""Outputs of the blending kernel: RGB, JPEG's planes, video's planes, input of `inverse_depth`."""
GREATEST: Final = 3.4e38
"""Of float32, nearly."""


@dataclass(frozen=True, slots=True)
class TileLayout:
    """A picture's tiles."""

    side: int
    """Pixels: 8 or 16."""
    columns: int
    rows: int
    slices: int
    """Depth is cut into so many, each with a list for every tile: a power of two, 256 at most."""

    @property
    def tiles(self) -> int:
        """How many there are."""
        return self.columns * self.rows


def tile_layout(width: int, height: int, gaussians: int) -> TileLayout:
    """The tiles of a picture of so many pixels and Gaussians."""
    side = 8 if width * height <= max(SMALL_PICTURE, gaussians) else 16
    columns, rows = -(-width // side), -(-height // side)
    slices = MAX_SLICES
    while slices > 4 and slices * columns * rows > MAX_LISTS:
        slices //= 2
    return TileLayout(side, columns, rows, slices)


def write_frame(
    into: ctypes.Array[ctypes.c_char],
    scene: CudaScene,
    camera: Camera,
    layout: TileLayout,
    format: PixelFormat,
    buffers: tuple[int, ...],
    capacity: int,
) -> None:
    """Fill `struct Frame`. buffers: the device's addresses from `splats` to `progress`, in the struct's order."""
    k = camera.intrinsics
    rotation = camera.pose.rotation
    dilation, low_pass = footprint(camera.display_scale, scene.antialiased)
    LAYOUT.pack_into(
        into, 0,
        scene.means.data_ptr(), scene.shapes.data_ptr(), scene.sh.data_ptr(), scene.bounds.data_ptr(), *buffers,
        scene.padded, scene.padded // CHUNK, capacity, layout.tiles, layout.columns, layout.slices,
        k.width, k.height, FORMATS[format], scene.coefficients,
        scene.scale_low, scene.scale_step,
        *(rotation[column][row] for row in range(3) for column in range(3)),  # world to camera
        *camera.pose.position,
        k.fx, k.fy, k.cx, k.cy, dilation, dilation + low_pass, *map(_float32, derivative_limits(camera.viewport)),
        *camera.background,
    )  # fmt: skip


def _float32(value: float) -> float:
    """The nearest value that a kernel can hold: the shortest focal lengths have limits beyond any."""
    return max(-GREATEST, min(GREATEST, value))
