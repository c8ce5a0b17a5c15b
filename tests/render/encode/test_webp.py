"""A WebP is smaller than the JPEG of the same quality, and no worse."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image, ImageDraw

from tests.render.encode.pictures import Pixels, gradient, psnr
from tigas_render.encode.images import encode_jpeg, encode_webp


@pytest.fixture(scope="module")
def scenery() -> Pixels:
    """Smooth walls, edges in all directions, and something fine-grained."""
    image = Image.fromarray(gradient(320, 180))
    draw, random = ImageDraw.Draw(image), np.random.default_rng(1)
    for x, y, radius, shade in random.integers((0, 0, 5, 0), (320, 180, 40, 255), (25, 4)).tolist():
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), (shade, 200 - shade // 2, 90))
    grain = random.normal(0, 6, (180, 320, 1))
    return np.clip(np.asarray(image) + grain, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("quality", [10, 35, 65, 90])
def test_webp_needs_fewer_bytes_than_jpeg_for_at_least_its_picture(scenery: Pixels, quality: int) -> None:
    webp, jpeg = encode_webp(scenery, quality), encode_jpeg(scenery, quality)
    decoded = [np.asarray(Image.open(io.BytesIO(each)).convert("RGB")) for each in (webp, jpeg)]
    assert Image.open(io.BytesIO(webp)).format == "WEBP"
    assert psnr(decoded[0], scenery) > psnr(decoded[1], scenery) - 0.2
    assert len(webp) < len(jpeg)


@pytest.mark.parametrize("quality", [1, 100])
def test_every_quality_has_a_picture(quality: int) -> None:
    assert Image.open(io.BytesIO(encode_webp(gradient(33, 17), quality))).size == (33, 17)
