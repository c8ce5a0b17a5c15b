"""Encoders of single images: JPEG and WebP, lossless PNG for ground truth, and raw planes for video encoders.

Raw planes are YUV 4:2:0 in BT.709, limited range (ITU-R BT.709-6, sections 3.2 to 3.5).
"""

from __future__ import annotations

import io
from typing import Final

import numpy as np
import numpy.typing as npt
import simplejpeg
from numba import njit
from PIL import Image

Pixels = npt.NDArray[np.uint8]

WEBP_METHOD: Final = 1
"""Effort, 0 to 6; see the comparison in docs/streams.md."""
_JPEG_QUALITIES: Final = (1, 10, 20, 35, 65, 90, 100)
_WEBP_QUALITIES: Final = (0, 3, 10, 28, 60, 88, 99)
"""JPEG qualities, and the WebP qualities with the same PSNR on the most demanding scene (docs/streams.md)."""
KR, KB = 0.2126, 0.0722
"""BT.709's luma weights of red and blue."""


def encode_jpeg(pixels: Pixels, quality: int) -> bytes:
    """Encode RGB pixels [H, W, 3] at a quality of 1 to 100, with 4:2:0 chroma as is usual for photographs."""
    encoded: bytes = simplejpeg.encode_jpeg(pixels, quality=quality, colorspace="RGB", colorsubsampling="420")
    return encoded


def encode_png(pixels: Pixels) -> bytes:
    """Encode RGB pixels [H, W, 3] losslessly, fast rather than small."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def encode_webp(pixels: Pixels, quality: int) -> bytes:
    """Encode RGB pixels [H, W, 3] with the PSNR of a JPEG of quality 1 to 100 (VP8 key frames, RFC 6386)."""
    buffer = io.BytesIO()
    equal = round(float(np.interp(quality, _JPEG_QUALITIES, _WEBP_QUALITIES)))
    Image.fromarray(pixels).save(buffer, "WEBP", quality=equal, method=WEBP_METHOD)
    return buffer.getvalue()


def encode_yuv420p(pixels: Pixels) -> bytes:
    """Convert RGB pixels [H, W, 3] to planes Y [H, W], Cb and Cr [⌈H/2⌉, ⌈W/2⌉], averaging chroma over four pixels."""
    height, width = pixels.shape[:2]
    chroma = ((height + 1) // 2, (width + 1) // 2)
    planes = np.empty(height * width + 2 * chroma[0] * chroma[1], np.uint8)
    y, cb, cr = np.split(planes, [height * width, height * width + chroma[0] * chroma[1]])
    _convert(pixels, y.reshape(height, width), cb.reshape(chroma), cr.reshape(chroma))
    return planes.tobytes()


@njit(cache=True, nogil=True, fastmath=True)
def _convert(rgb, luma, cb, cr):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    height, width = luma.shape
    kr, kb = np.float32(KR), np.float32(KB)
    kg = np.float32(1) - kr - kb
    to_luma, to_chroma = np.float32(219 / 255), np.float32(224 / 255)
    for row in range(cb.shape[0]):
        for column in range(cb.shape[1]):
            sum_r = sum_g = sum_b = np.float32(0)
            for dy in range(2):
                y = min(2 * row + dy, height - 1)
                for dx in range(2):
                    x = min(2 * column + dx, width - 1)
                    r, g, b = np.float32(rgb[y, x, 0]), np.float32(rgb[y, x, 1]), np.float32(rgb[y, x, 2])
                    luma[y, x] = np.uint8(np.float32(16.5) + to_luma * (kr * r + kg * g + kb * b))
                    sum_r += r
                    sum_g += g
                    sum_b += b
            mean_r, mean_b = np.float32(0.25) * sum_r, np.float32(0.25) * sum_b
            mean_y = kr * mean_r + kg * np.float32(0.25) * sum_g + kb * mean_b
            half = np.float32(0.5)
            cb[row, column] = np.uint8(np.float32(128.5) + to_chroma * half * (mean_b - mean_y) / (np.float32(1) - kb))
            cr[row, column] = np.uint8(np.float32(128.5) + to_chroma * half * (mean_r - mean_y) / (np.float32(1) - kr))
