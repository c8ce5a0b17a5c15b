"""A synthetic rasteriser that makes grey frames of a given size in bytes, immediately or at a given rate.

Tests and benchmarks of everything except rendering use it as the device `instant`, `instant:BYTES` or
`instant:BYTES:FRAMES_PER_S`, which is not documented elsewhere.
"""

from __future__ import annotations

import ctypes
import functools
from dataclasses import dataclass

import numpy as np

from tigas_common.wire.render import FrameFormat
from tigas_render.encode.images import encode_jpeg, encode_yuv420p
from tigas_render.gaussians import Batches
from tigas_render.raster.base import Camera, PreparedScene
from tigas_render.raster.calls import Call, FrameCalls
from tigas_render.raster.lanes import FetchedImage, Job, LaneRasterizer

NAME = "instant"
DEFAULT_BYTES = 23_000
"""Typical size of a captured scene's frame at the third rung."""
GREY = 128
QUALITY = 50

_libc = ctypes.CDLL(None)


class InstantScene(PreparedScene):
    """An empty scene."""

    nbytes = 0


@dataclass
class InstantJob(Job):
    """A grey image, after a delay."""

    width: int
    height: int
    format: FrameFormat
    quality: int
    jpeg_bytes: int
    delay: FrameCalls
    free: list[FrameCalls]

    def calls(self) -> FrameCalls:
        return self.delay

    def fetched(self) -> FetchedImage:
        if self.format == "jpeg":
            content = synthetic_jpeg(self.width, self.height, self.jpeg_bytes)
        else:
            pixels = np.full((self.height, self.width, 3), GREY, np.uint8)
            content = pixels.tobytes() if self.format == "png" else encode_yuv420p(pixels)
        return FetchedImage(self.width, self.height, self.format, self.quality, content)

    def close(self, *, failed: bool) -> None:
        self.free.append(self.delay)


class InstantRasterizer(LaneRasterizer):
    """Makes grey frames without depth at an unlimited or a given rate."""

    device = NAME
    hardware = "nothing: frames are made up"

    def __init__(self, size: int = DEFAULT_BYTES, frames_per_s: int | None = None) -> None:
        """size: of every JPEG, in bytes. frames_per_s: upper limit; None for no limit."""
        self._size = size
        self._delay = Call(_libc.usleep, (round(1e6 / frames_per_s) if frames_per_s else 0,))
        self._free: list[FrameCalls] = []
        self.frames_in_flight = 1 if frames_per_s else 6  # CUDA's minimum

    def pack(self, scene: Batches) -> PreparedScene:
        for _ in scene.parts:
            pass
        return InstantScene()

    def job(self, scene: PreparedScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool) -> Job:
        k = camera.intrinsics
        try:
            delay = self._free.pop()
        except IndexError:
            delay = FrameCalls((self._delay,), ())
        return InstantJob(k.width, k.height, format, quality, self._size, delay, self._free)


@functools.lru_cache(64)
def synthetic_jpeg(width: int, height: int, size: int) -> bytes:
    """A grey JPEG of `size` bytes, or longer if this is too short."""
    jpeg = encode_jpeg(np.full((height, width, 3), GREY, np.uint8), QUALITY)
    fill = b"\xff" * (size - len(jpeg))  # allowed before any marker (ITU T.81, B.1.1.2)
    return jpeg[:2] + fill + jpeg[2:]
