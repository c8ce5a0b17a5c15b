"""Every codec gives a file that an independent decoder reads back as the same picture."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from tigas_render.encode.jpeg import encode_jpeg
from tigas_render.encode.png import encode_png
from tigas_render.encode.yuv420p import encode_yuv420p

Pixels = npt.NDArray[np.uint8]


def gradient(width: int, height: int) -> Pixels:
    """A smooth colourful picture [height, width, 3]."""
    y, x = np.mgrid[0:height, 0:width]
    channels = (255 * x / max(1, width - 1), 255 * y / max(1, height - 1), 255 - 127 * (x + y) / (width + height))
    return np.stack(channels, -1).astype(np.uint8)


def psnr(a: Pixels, b: Pixels) -> float:
    """Peak signal-to-noise ratio in dB."""
    return float(10 * np.log10(255**2 / max(1e-9, np.mean((a.astype(float) - b.astype(float)) ** 2))))


SIZES = [(320, 180), (33, 17), (1, 1), (2, 301)]


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_png_is_lossless(width: int, height: int) -> None:
    pixels = gradient(width, height)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(encode_png(pixels)))), pixels)


@pytest.mark.parametrize(("width", "height"), SIZES[:2])
def test_jpeg_shows_the_same_picture_and_grows_with_quality(width: int, height: int) -> None:
    pixels = gradient(width, height)
    sizes = []
    for quality, least in ((10, 22), (35, 28), (90, 33)):
        encoded = encode_jpeg(pixels, quality)
        assert psnr(np.asarray(Image.open(io.BytesIO(encoded))), pixels) > least
        sizes.append(len(encoded))
    assert sizes == sorted(sizes)


def test_jpeg_and_png_take_a_view_of_a_larger_buffer() -> None:
    buffer = np.zeros(100 * 100 * 3, np.uint8)
    view = buffer[: 32 * 16 * 3].reshape(16, 32, 3)
    assert Image.open(io.BytesIO(encode_jpeg(view, 90))).size == (32, 16)
    assert Image.open(io.BytesIO(encode_png(view))).size == (32, 16)


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
