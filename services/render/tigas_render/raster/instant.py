"""Renders nothing: grey frames of a given size in bytes, at once, or as many a second as a real device would make.

Everything but rendering can be measured with it.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.render import FrameFormat
from tigas_render.encode.jpeg import encode_jpeg
from tigas_render.gaussians import Batches
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene
from tigas_render.raster.calls import Call, Calls
from tigas_render.raster.host_image import HostImage
from tigas_render.raster.lanes import FetchedImage, Job, LaneRasterizer

NAME = "instant"
DEFAULT_BYTES = 23_000
"""Of a frame: a captured scene's at the third rung."""
GREY = 128
QUALITY = 50


_libc = ctypes.CDLL(None)


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


@dataclass
class InstantJob(Job):
    """A grey JPEG, or other pixels, after a while."""

    image: InstantImage
    format: FrameFormat
    quality: int
    wait: Calls

    def calls(self) -> tuple[tuple[Calls], tuple[()]]:
        return (self.wait,), ()

    def fetched(self) -> FetchedImage:
        image = self.image
        is_png = self.format == "png"
        content = image.to_host().tobytes() if is_png else image.encode(self.format, self.quality)
        return FetchedImage(image.width, image.height, self.format, content)

    def explained(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def close(self, *, failed: bool) -> None:
        """There is nothing to give back."""


class InstantRasterizer(LaneRasterizer):
    """Takes no time, or as much as it is told to."""

    device = NAME
    frames_in_flight = 6  # as CUDA's
    hardware = "nothing: frames are made up"

    def __init__(self, size: int = DEFAULT_BYTES, frames_per_s: int | None = None) -> None:
        """size: bytes of every JPEG; frames_per_s: at most; None: as many as are asked for."""
        self._size = size
        self._seconds = 1 / frames_per_s if frames_per_s else 0.0
        self._wait = Calls(Call(_libc.usleep, (round(1e6 * self._seconds),)))
        self.lanes = 1 if frames_per_s else self.frames_in_flight

    def pack(self, scene: Batches) -> PreparedScene:
        """Nothing has to be packed, only read."""
        for _ in scene.parts:
            pass
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
        return self._image(camera)

    def job(self, scene: PreparedScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool) -> Job:
        """As `render`, for a lane."""
        return InstantJob(self._image(camera), format, quality, self._wait)

    def _image(self, camera: Camera) -> InstantImage:
        return InstantImage(camera.intrinsics.width, camera.intrinsics.height, self._size)


@functools.lru_cache(64)
def made_up_jpeg(width: int, height: int, size: int) -> bytes:
    """A grey JPEG of `size` bytes; longer if it takes more to be one."""
    jpeg = encode_jpeg(np.full((height, width, 3), GREY, np.uint8), QUALITY)
    fill = b"\xff" * (size - len(jpeg))  # allowed before any marker (ITU T.81, B.1.1.2)
    return jpeg[:2] + fill + jpeg[2:]
