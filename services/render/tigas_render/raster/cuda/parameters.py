"""The parameters that the kernels take for a frame: its tiles, and `struct Frame` of frame.cuh."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

from tigas_common.pose import Intrinsics
from tigas_common.wire.render import FrameFormat
from tigas_render.raster.base import Camera, derivative_limits, footprint
from tigas_render.raster.cuda.levels import EDGE_PIXELS
from tigas_render.raster.cuda.scene import CODES, POINTERS, CudaScene

SMALL_PICTURE = 640 * 360
"""Number of pixels up to which an image has small tiles, because large ones would keep few multiprocessors busy. So
does an image with more Gaussians than pixels, because these Gaussians are small. See docs/architecture.md."""

MAX_SLICES = 256
"""Maximum number of slices: a slice's number has 8 bits."""
MAX_LISTS, MOST_LISTS = 1 << 18, 1 << 21
"""Limits on the number of lists of all tiles and slices: enough to keep each list short, few enough to count in
microseconds. Scenes of millions have one for every eight Gaussians, up to the second limit."""
_PLAN: Final = struct.Struct("=18Q6I3i")
"""The other pointers; padded, capacity, room, tiles, tiles_x, slices; width, height, format."""
_POSE: Final = struct.Struct("=12f")
"""rotation, eye."""
_LENS: Final = struct.Struct("=14f")
"""The other floats."""
SIZE: Final = sum(part.size for part in (POINTERS, _PLAN, CODES, _POSE, _LENS))
"""Size of `struct Frame` in bytes."""
PixelFormat = FrameFormat | Literal["depth"]
FORMATS: Final[dict[PixelFormat, int]] = {"png": 0, "jpeg": 1, "yuv420p": 2, "depth": 3}
"""Outputs of the blending kernel: RGB, JPEG's planes, video's planes, input of `inverse_depth`."""
GREATEST: Final = 3.4e38
"""Approximately the largest float32."""


@dataclass(frozen=True, slots=True)
class TileLayout:
    """The tiles of an image."""

    side: int
    """Side length in pixels: 8 or 16."""
    columns: int
    rows: int
    slices: int
    """Number of slices of depth, each with a list for every tile: a power of two, at most 256."""

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows


def tile_layout(width: int, height: int, gaussians: int) -> TileLayout:
    """The tiles of an image of this size in pixels, for a scene with this number of Gaussians."""
    side = 8 if width * height <= max(SMALL_PICTURE, gaussians) else 16
    columns, rows = -(-width // side), -(-height // side)
    slices, most = MAX_SLICES, max(MAX_LISTS, min(gaussians // 8, MOST_LISTS))
    while slices > 4 and slices * columns * rows > most:
        slices //= 2
    return TileLayout(side, columns, rows, slices)


def plan_numbers(
    width: int,
    height: int,
    padded: int,
    layout: TileLayout,
    format: PixelFormat,
    buffers: tuple[int, ...],
    capacity: int,
    room: int,
) -> bytes:
    """The part of `struct Frame` that all frames of a size and format share.

    padded: number of Gaussians, including padding. buffers: device addresses from `splats` to `progress`, in the
    struct's order. capacity: number of list entries. room: number of chunks for which the buffers have slots.
    """
    return _PLAN.pack(
        *buffers, padded, capacity, room, layout.tiles, layout.columns, layout.slices, width, height, FORMATS[format]
    )


def frame_parameters(scene: CudaScene, camera: Camera, plan: bytes) -> bytes:
    """`struct Frame`. plan: from `plan_numbers`."""
    (a, b, c), (d, e, f), (g, h, i) = camera.pose.rotation
    pose = _POSE.pack(a, d, g, b, e, h, c, f, i, *camera.pose.position)  # world to camera
    edge_pixels = 0.0 if camera.full_detail else EDGE_PIXELS
    lens = _lens(
        camera.intrinsics, camera.margins, camera.display_scale, camera.background, scene.antialiased, edge_pixels
    )
    return b"".join((scene.pointers, plan, scene.codes, pose, lens))


@lru_cache(maxsize=1024)  # a viewer uses the same lens, or a few, for thousands of frames
def _lens(
    k: Intrinsics,
    margins: tuple[int, int],
    display_scale: float,
    background: tuple[float, float, float],
    antialiased: bool,
    edge_pixels: float,
) -> bytes:
    dilation, low_pass = footprint(display_scale, antialiased)
    limits = derivative_limits(k.with_margins(-margins[0], -margins[1]))
    numbers = k.fx, k.fy, k.cx, k.cy, dilation, dilation + low_pass
    reach = edge_pixels / max(k.fx, k.fy)
    return _LENS.pack(*numbers, *map(_float32, limits), *background, _float32(reach))


def _float32(value: float) -> float:
    """The nearest float32, since the limits for the shortest focal lengths are out of range."""
    return max(-GREATEST, min(GREATEST, value))
