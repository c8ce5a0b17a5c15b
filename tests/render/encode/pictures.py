"""Pictures to encode."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[np.uint8]


def gradient(width: int, height: int) -> Pixels:
    """A smooth colourful picture [height, width, 3]."""
    y, x = np.mgrid[0:height, 0:width]
    channels = (255 * x / max(1, width - 1), 255 * y / max(1, height - 1), 255 - 127 * (x + y) / (width + height))
    return np.stack(channels, -1).astype(np.uint8)
