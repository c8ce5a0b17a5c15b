"""Buffers of a rasteriser: they grow, and are never reallocated for a frame that fits."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

ALIGNMENT = 64
"""Bytes: a cache line."""


class Workspace:
    """Named one-dimensional buffers; asking for more than there is makes a buffer half again as large, content lost."""

    def __init__(self) -> None:
        self._buffers: dict[str, NDArray[Any]] = {}

    def get(self, name: str, size: int, dtype: DTypeLike) -> NDArray[Any]:
        """The first `size` items of the buffer `name`, aligned to a cache line; not cleared."""
        buffer = self._buffers.get(name)
        if buffer is None or buffer.size < size:
            buffer = _aligned(max(size, 3 * buffer.size // 2 if buffer is not None else 0), np.dtype(dtype))
            self._buffers[name] = buffer
        return buffer[:size]


def _aligned(size: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    raw = np.empty(size * dtype.itemsize + ALIGNMENT, np.uint8)
    offset = -raw.ctypes.data % ALIGNMENT
    return raw[offset : offset + size * dtype.itemsize].view(dtype)
