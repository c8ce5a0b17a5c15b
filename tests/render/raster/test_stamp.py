"""The stamp can be read from whatever becomes of a frame."""

from __future__ import annotations

import io

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tigas_render.encode.jpeg import encode_jpeg
from tigas_render.encode.yuv420p import encode_yuv420p
from tigas_render.raster.stamp import draw_stamp, read_stamp


def noise(width: int, height: int) -> NDArray[np.uint8]:
    """A picture that is as hard to encode as any, uint8 [H, W, 3]."""
    return np.random.default_rng(1).integers(0, 256, (height, width, 3), np.uint8)


@pytest.mark.parametrize("number", [0, 1, 0xABCDEF, 2**24 - 1])
@pytest.mark.parametrize(("width", "height"), [(320, 180), (1280, 720), (333, 517)])
def test_survives_the_lowest_quality(number: int, width: int, height: int) -> None:
    pixels = noise(width, height)
    draw_stamp(pixels, number)
    decoded = Image.open(io.BytesIO(encode_jpeg(pixels, 10)))
    assert read_stamp(np.asarray(decoded)) == number


def test_survives_scaling() -> None:
    pixels = noise(320, 180)
    draw_stamp(pixels, 123_456)
    shown = Image.fromarray(pixels).resize((1277, 718), Image.Resampling.BILINEAR)
    assert read_stamp(np.asarray(shown)) == 123_456


def test_is_black_and_white_in_limited_range_video() -> None:
    pixels = noise(640, 360)
    draw_stamp(pixels, 1)
    luma = np.frombuffer(encode_yuv420p(pixels), np.uint8)[: 640 * 20].reshape(20, 640)
    assert set(np.unique(luma)) == {16, 235}


def test_a_frame_without_a_stamp_has_none() -> None:
    assert read_stamp(noise(640, 360)) is None
    assert read_stamp(np.zeros((360, 640, 3), np.uint8)) is None


def test_leaves_the_rest_of_the_frame_alone() -> None:
    before = noise(640, 360)
    after = before.copy()
    draw_stamp(after, 7)
    assert np.array_equal(before[20:], after[20:])
