"""An independent decoder reads the same picture from a JPEG."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from tests.render.encode.pictures import gradient, psnr
from tigas_render.encode.images import encode_jpeg


@pytest.mark.parametrize(("width", "height"), [(320, 180), (33, 17)])
def test_jpeg_shows_the_same_picture_and_grows_with_quality(width: int, height: int) -> None:
    pixels = gradient(width, height)
    sizes = []
    for quality, least in ((10, 22), (35, 28), (90, 33)):
        encoded = encode_jpeg(pixels, quality)
        assert psnr(np.asarray(Image.open(io.BytesIO(encoded))), pixels) > least
        sizes.append(len(encoded))
    assert sizes == sorted(sizes)


def test_jpeg_takes_a_view_of_a_larger_buffer() -> None:
    view = np.zeros(100 * 100 * 3, np.uint8)[: 32 * 16 * 3].reshape(16, 32, 3)
    assert Image.open(io.BytesIO(encode_jpeg(view, 90))).size == (32, 16)
