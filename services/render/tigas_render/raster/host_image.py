"""Images in the host's memory, and the pool of framebuffers that they use."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.render import FrameFormat
from tigas_render.encode.images import encode_jpeg, encode_png, encode_yuv420p
from tigas_render.raster.base import Depth, Image

Pixels = NDArray[np.uint8]
MAX_FREE = 4
"""Maximum number of free framebuffers to keep."""


class HostImage(Image):
    """RGB pixels as a NumPy array. `on_close` is called once, when they are no longer needed."""

    def __init__(self, pixels: Pixels, on_close: Callable[[], None] | None = None) -> None:
        self.height, self.width = pixels.shape[:2]
        self.depth: Depth | None = None
        self._pixels: Pixels | None = pixels
        self._on_close = on_close

    def to_host(self) -> Pixels:
        """The pixels themselves, C-contiguous. Raises ValueError once the image is closed."""
        if self._pixels is None:
            raise ValueError("the image is closed")
        return self._pixels

    def encode(self, format: FrameFormat, quality: int) -> bytes:
        match format:
            case "jpeg":
                return encode_jpeg(self.to_host(), quality)
            case "png":
                return encode_png(self.to_host())
            case "yuv420p":
                return encode_yuv420p(self.to_host())
            case _:
                assert_never(format)

    def close(self) -> None:
        on_close, self._on_close, self._pixels = self._on_close, None, None
        if on_close is not None:
            on_close()


class FramebufferPool:
    """A pool of framebuffers, which allows one frame to be encoded while the next is rendered.

    Images may be closed from any thread. The pool keeps as many buffers as were ever in use at once, at most KEPT.
    """

    def __init__(self) -> None:
        self._free: list[Pixels] = []
        self._lock = threading.Lock()

    def image(self, width: int, height: int) -> HostImage:
        """An image of `width` × `height` pixels with undefined content."""
        size = height * width * 3
        with self._lock:
            buffer = self._free.pop() if self._free else np.empty(0, np.uint8)
        if buffer.size < size:
            buffer = np.empty(max(size, buffer.size * 3 // 2), np.uint8)
        return HostImage(buffer[:size].reshape(height, width, 3), lambda: self._recycle(buffer))

    def _recycle(self, buffer: Pixels) -> None:
        with self._lock:
            if len(self._free) < MAX_FREE:
                self._free.append(buffer)
