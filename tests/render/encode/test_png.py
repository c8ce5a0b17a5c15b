"""An independent decoder reads the same picture from a PNG."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from tests.render.encode.pictures import gradient
from tigas_render.encode.images import encode_png


@pytest.mark.parametrize(("width", "height"), [(320, 180), (33, 17), (1, 1), (2, 301)])
def test_png_is_lossless(width: int, height: int) -> None:
    pixels = gradient(width, height)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(encode_png(pixels)))), pixels)


def test_png_takes_a_view_of_a_larger_buffer() -> None:
    view = np.zeros(100 * 100 * 3, np.uint8)[: 32 * 16 * 3].reshape(16, 32, 3)
    assert Image.open(io.BytesIO(encode_png(view))).size == (32, 16)
