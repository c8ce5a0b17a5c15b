"""Lossy WebP (VP8 key frames, RFC 6386) through libwebp, which holds no interpreter lock while it encodes."""

from __future__ import annotations

import io
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

METHOD: Final = 1
"""Effort, 0 to 6: docs/streams.md compares them."""
_OF_JPEG: Final = (1, 10, 20, 35, 65, 90, 100)
_OF_WEBP: Final = (0, 3, 10, 28, 60, 88, 99)
"""WebP quality with the PSNR of a JPEG quality, on the most demanding scene (docs/streams.md)."""


def encode_webp(pixels: npt.NDArray[np.uint8], quality: int) -> bytes:
    """Encode RGB pixels [H, W, 3] with the PSNR of a JPEG of quality 1 to 100."""
    buffer = io.BytesIO()
    equal = round(float(np.interp(quality, _OF_JPEG, _OF_WEBP)))
    Image.fromarray(pixels).save(buffer, "WEBP", quality=equal, method=METHOD)
    return buffer.getvalue()
