"""Views of a scene without a renderer: sharp discs on black, and a ladder's JPEGs of them."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from tigas_enhance.pairs import Pair

WIDTH, HEIGHT = 160, 96
LOW = {1: (120, 72), 2: (80, 48)}
"""The rungs' sizes."""
QUALITY = 90


def view(seed: int) -> NDArray[np.uint8]:
    """[HEIGHT, WIDTH, 3], on black."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for _ in range(60):
        cy, cx, radius = random.uniform(0, HEIGHT), random.uniform(0, WIDTH), random.uniform(3, 12)
        pixels[(y - cy) ** 2 + (x - cx) ** 2 < radius**2] = random.integers(30, 255, 3)
    return pixels


def as_jpeg(pixels: NDArray[np.uint8], width: int, height: int) -> bytes:
    """A view at a rung's size, blurred, so that there is something to learn in a few steps."""
    buffer = io.BytesIO()
    blurred = Image.fromarray(pixels).filter(ImageFilter.GaussianBlur(2))
    blurred.resize((width, height), Image.Resampling.BOX).save(buffer, "JPEG", quality=QUALITY)
    return buffer.getvalue()


def pair(seed: int) -> Pair:
    full = view(seed)
    rungs = {
        rung: np.asarray(Image.open(io.BytesIO(as_jpeg(full, *size))).convert("RGB")) for rung, size in LOW.items()
    }
    return Pair(full, full.max(axis=2) > 0, rungs)
