"""The encoders under test: what they are called, their qualities, and how they are called.

JPEG XL and jpegli come from packages that nothing else needs (`pip install imagecodecs pyjpegli`); without them their
rows are left out, which is said.
"""

from __future__ import annotations

import importlib
import importlib.util
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_render.encode.jpeg import encode_jpeg

Picture = NDArray[np.uint8]
TODAY = "JPEG"
"""What all others are compared with."""

ROBIDOUX = (
    16, 16, 16, 18, 25, 37, 56, 85,
    16, 17, 20, 27, 34, 40, 53, 75,
    16, 20, 24, 31, 43, 62, 91, 135,
    18, 27, 31, 40, 53, 74, 106, 156,
    25, 34, 43, 53, 69, 94, 131, 189,
    37, 40, 62, 74, 94, 124, 169, 238,
    56, 53, 91, 106, 131, 169, 226, 311,
    85, 75, 135, 156, 189, 238, 311, 418,
)  # fmt: skip
"""Quantisation of luma and chroma at quality 50, by Nicolas Robidoux: mozjpeg's default."""


@dataclass(frozen=True)
class Codec:
    """One row of the tables."""

    name: str
    encode: Callable[[Picture, float], bytes]
    """Of RGB pixels [H, W, 3] at a quality."""
    qualities: tuple[float, ...]
    """From poor to good, about as wide as JPEG at 10 to 90."""
    mime: str


JPEG_QUALITIES = (10, 20, 35, 65, 90)
WEBP_QUALITIES = (0, 8, 30, 60, 88)
AVIF_QUALITIES = (8, 20, 42, 62, 80)
JXL_DISTANCES = (14, 7, 4, 2, 0.8)
"""Butteraugli distances, JPEG XL's own scale."""


def codecs() -> Iterator[Codec]:
    """All that are installed, today's first."""
    jpeg = partial(Codec, qualities=JPEG_QUALITIES, mime="image/jpeg")
    yield jpeg(TODAY, lambda pixels, quality: encode_jpeg(pixels, int(quality)))
    yield jpeg("JPEG, optimised Huffman", partial(_pillow, "JPEG", optimize=True))
    yield jpeg("JPEG, progressive", partial(_pillow, "JPEG", progressive=True))
    yield jpeg("JPEG, Robidoux's tables", _with_tables)
    if importlib.util.find_spec("pyjpegli"):
        yield jpeg("jpegli", _jpegli)
    for method in (0, 1, 2):
        yield Codec(f"WebP, method {method}", partial(_pillow, "WEBP", method=method), WEBP_QUALITIES, "image/webp")
    yield Codec("AVIF, speed 10", partial(_pillow, "AVIF", speed=10, max_threads=1), AVIF_QUALITIES, "image/avif")
    if importlib.util.find_spec("imagecodecs"):
        yield Codec("JPEG XL, effort 3", _jxl, JXL_DISTANCES, "image/jxl")


def _pillow(format: str, pixels: Picture, quality: float, **options: Any) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format, quality=int(quality), **options)
    return buffer.getvalue()


def _with_tables(pixels: Picture, quality: float) -> bytes:
    """Scaled by quality as libjpeg does (jpeg_quality_scaling)."""
    percent = 5000 / quality if quality < 50 else 200 - 2 * quality
    scaled = [min(255, max(1, round(value * percent / 100))) for value in ROBIDOUX]
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", qtables=[scaled, scaled], quality=-1, subsampling="4:2:0")
    return buffer.getvalue()


def _jpegli(pixels: Picture, quality: float) -> bytes:
    height, width = pixels.shape[:2]
    encoded: bytes = importlib.import_module("pyjpegli").encode(pixels.tobytes(), width, height, int(quality))
    return encoded


def _jxl(pixels: Picture, distance: float) -> bytes:
    codec = importlib.import_module("imagecodecs")
    encoded: bytes = codec.jpegxl_encode(pixels, distance=distance, effort=3, numthreads=1)
    return encoded


def decoded(encoded: bytes) -> Picture:
    """RGB pixels [H, W, 3]."""
    if encoded[:2] == b"\xff\x0a" or encoded[4:8] == b"JXL ":
        pixels: Picture = importlib.import_module("imagecodecs").jpegxl_decode(encoded, numthreads=1)
        return pixels
    with Image.open(io.BytesIO(encoded)) as image:
        return np.asarray(image.convert("RGB"))
