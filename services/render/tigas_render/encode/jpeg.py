"""JPEG through libjpeg-turbo (simplejpeg), with 4:2:0 chroma as usual for photographs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import simplejpeg


def encode_jpeg(pixels: npt.NDArray[np.uint8], quality: int) -> bytes:
    """Encode RGB pixels [H, W, 3] at a quality of 1 to 100."""
    encoded: bytes = simplejpeg.encode_jpeg(pixels, quality=quality, colorspace="RGB", colorsubsampling="420")
    return encoded
