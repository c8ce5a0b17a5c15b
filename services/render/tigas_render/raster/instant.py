"""Renders nothing: grey frames of a given size in bytes, at once, or as many a second as a real device would make.

Everything but rendering can be measured with it.
"""

from __future__ import annotations

import functools
import time

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.render import FrameFormat
from tigas_render.encode.jpeg import encode_jpeg
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, Rasterizer
from tigas_render.raster.host_image import HostImage

NAME = "instant"
DEFAULT_BYTES = 23_000
"""Of a frame: a captured scene's at the third rung."""
GREY = 128
QUALITY = 50


class InstantScene(PreparedScene):
    """Nothing is kept of a scene."""

    nbytes = 0


class InstantImage(Image):
    """Grey, and as a JPEG as long as was asked for."""

    def __init__(self, width: int, height: int, size: int) -> None:
        """size: bytes of the JPEG."""
        self.width, self.height = width, height
        self._size = size

    def encode(self, format: FrameFormat, quality: int) -> bytes:
        """The same JPEG for every frame of these sides; other formats as long as they are."""
        if format == "jpeg":
            return made_up_jpeg(self.width, self.height, self._size)
        return HostImage(self.to_host()).encode(format, quality)

    def to_host(self) -> NDArray[np.uint8]:
        """RGB [H, W, 3]."""
        return np.full((self.height, self.width, 3), GREY, np.uint8)

    def close(self) -> None:
        """There is nothing to give back."""


class InstantRasterizer(Rasterizer):
    """Takes no time, or as much as it is told to."""

    device = NAME
    frames_in_flight = 6  # as CUDA's
    hardware = "nothing: frames are made up"

    def __init__(self, size: int = DEFAULT_BYTES, frames_per_s: int | None = None) -> None:
        """size: bytes of every JPEG; frames_per_s: at most; None: as many as are asked for."""
        self._size = size
        self._seconds = 1 / frames_per_s if frames_per_s else 0.0

    def prepare(self, gaussians: Gaussians) -> PreparedScene:
        """Nothing has to be packed."""
        return InstantScene()

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> Image:
        """A grey image; it never has a depth."""
        if self._seconds:
            time.sleep(self._seconds)
        return InstantImage(camera.intrinsics.width, camera.intrinsics.height, self._size)


@functools.lru_cache(64)
def made_up_jpeg(width: int, height: int, size: int) -> bytes:
    """A grey JPEG of `size` bytes; longer if it takes more to be one."""
    jpeg = encode_jpeg(np.full((height, width, 3), GREY, np.uint8), QUALITY)
    fill = b"\xff" * (size - len(jpeg))  # allowed before any marker (ITU T.81, B.1.1.2)
    return jpeg[:2] + fill + jpeg[2:]
