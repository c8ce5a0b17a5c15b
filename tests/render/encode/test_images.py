"""Independent decoders read the same picture from each format."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image, ImageDraw

from tests.render.encode.pictures import Pixels, gradient
from tests.render.raster.views import psnr
from tigas_render.encode.images import encode_jpeg, encode_png, encode_webp, encode_yuv420p


def decoded(content: bytes) -> Pixels:
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))


@pytest.mark.parametrize(("width", "height"), [(320, 180), (33, 17)])
def test_jpeg_shows_the_same_picture_and_grows_with_quality(width: int, height: int) -> None:
    pixels = gradient(width, height)
    sizes = []
    for quality, least in ((10, 22), (35, 28), (90, 33)):
        encoded = encode_jpeg(pixels, quality)
        assert psnr(decoded(encoded), pixels) > least
        sizes.append(len(encoded))
    assert sizes == sorted(sizes)


@pytest.mark.parametrize(("width", "height"), [(320, 180), (33, 17), (1, 1), (2, 301)])
def test_png_is_lossless(width: int, height: int) -> None:
    pixels = gradient(width, height)
    assert np.array_equal(decoded(encode_png(pixels)), pixels)


def test_a_picture_may_be_a_view_of_a_larger_buffer() -> None:
    view = np.zeros(100 * 100 * 3, np.uint8)[: 32 * 16 * 3].reshape(16, 32, 3)
    for content in (encode_jpeg(view, 90), encode_png(view)):
        assert decoded(content).shape == view.shape


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
    assert Image.open(io.BytesIO(webp)).format == "WEBP"
    assert psnr(decoded(webp), scenery) > psnr(decoded(jpeg), scenery) - 0.2
    assert len(webp) < len(jpeg)


@pytest.mark.parametrize("quality", [1, 100])
def test_every_quality_of_webp_has_a_picture(quality: int) -> None:
    assert decoded(encode_webp(gradient(33, 17), quality)).shape == (17, 33, 3)


@pytest.mark.parametrize(
    ("rgb", "yuv"),
    [
        ((0, 0, 0), (16, 128, 128)),
        ((255, 255, 255), (235, 128, 128)),
        ((255, 0, 0), (63, 102, 240)),
        ((0, 255, 0), (173, 42, 26)),
        ((0, 0, 255), (32, 240, 118)),
    ],
)
def test_yuv420p_has_the_published_values_of_the_primaries(rgb: tuple[int, ...], yuv: tuple[int, ...]) -> None:
    """The 8-bit code values of BT.709's primaries, limited range."""
    pixels = np.broadcast_to(np.array(rgb, np.uint8), (5, 7, 3)).copy()
    planes = np.frombuffer(encode_yuv420p(pixels), np.uint8)
    assert planes.size == 5 * 7 + 2 * 3 * 4
    means = [plane.mean() for plane in np.split(planes, [35, 47])]
    assert means == pytest.approx(yuv, abs=1)
    assert all(np.ptp(plane) == 0 for plane in np.split(planes, [35, 47]))
