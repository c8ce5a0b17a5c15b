"""A JPEG or WebP carries its depth where no other decoder minds, in few bytes, near enough to the truth."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.render.encode.pictures import gradient
from tigas_render.encode.depth_segment import IDENTIFIER, encode_depth, insert_depth
from tigas_render.encode.images import encode_jpeg, encode_webp

JPEG = encode_jpeg(gradient(64, 36), 80)
WEBPS = [encode_webp(gradient(64, 36), quality) for quality in (20, 50, 80)]


def room(width: int = 184, height: int = 104) -> NDArray[np.float32]:
    """A floor with a pillar on it, and an empty sky."""
    inverse = np.linspace(-0.2, 0.4, height, dtype=np.float32).clip(0)[:, None].repeat(width, 1)
    inverse[:, width // 3 : width // 2] = 0.35
    return inverse


def read(jpeg: bytes) -> tuple[float, NDArray[np.uint8]]:
    """The inverse depth of code 255, and the codes."""
    assert jpeg[:4] == b"\xff\xd8\xff\xe9"
    (length,) = struct.unpack(">H", jpeg[4:6])
    content = jpeg[6 : 4 + length]
    assert content.startswith(IDENTIFIER)
    (nearest,) = struct.unpack(">f", content[12:16])
    return nearest, np.asarray(Image.open(io.BytesIO(content[16:])).convert("L"))


def test_the_picture_is_the_same_to_every_other_reader() -> None:
    both = [np.asarray(Image.open(io.BytesIO(jpeg))) for jpeg in (JPEG, insert_depth(JPEG, encode_depth(room())))]
    assert (both[0] == both[1]).all()


@pytest.mark.parametrize("webp", WEBPS)
def test_a_webp_has_the_same_depth_as_a_jpeg_in_a_chunk_of_its_own(webp: bytes) -> None:
    deep = insert_depth(webp, encode_depth(room()))
    both = [np.asarray(Image.open(io.BytesIO(each))) for each in (webp, deep)]
    assert (both[0] == both[1]).all()
    assert struct.unpack("<I", deep[4:8])[0] == len(deep) - 8
    name, length = struct.unpack("<4sI", deep[len(webp) : len(webp) + 8])
    content = deep[len(webp) + 8 :][:length]
    assert (name, len(deep)) == (b"TDEP", len(webp) + 8 + length + length % 2)
    nearest, codes = read(insert_depth(JPEG, encode_depth(room())))
    assert struct.unpack(">f", content[:4])[0] == pytest.approx(nearest)
    assert (np.asarray(Image.open(io.BytesIO(content[4:])).convert("L")) == codes).all()


def test_depth_comes_back_nearly_as_it_was_in_few_bytes() -> None:
    nearest, codes = read(insert_depth(JPEG, encode_depth(room())))
    error = codes * (nearest / 255) - room()
    assert codes.shape == (104, 184)
    assert np.sqrt(np.mean(error**2)) < 0.015 * nearest
    assert len(insert_depth(JPEG, encode_depth(room()))) - len(JPEG) < 1500


def test_a_speck_before_the_lens_does_not_take_the_others_codes() -> None:
    inverse = room()
    inverse[50:54, 10:14] = 100
    nearest, codes = read(insert_depth(JPEG, encode_depth(inverse)))
    assert nearest == pytest.approx(0.4, rel=0.02)
    assert codes[51:53, 11:13].min() > 240


@pytest.mark.parametrize("shape", [(104, 184), (1, 1), (1, 4096)])
def test_nothing_at_all_is_infinitely_far(shape: tuple[int, int]) -> None:
    nearest, codes = read(insert_depth(JPEG, encode_depth(np.zeros(shape, np.float32))))
    assert nearest == 0  # for any codes
    assert codes.shape == shape


def test_a_thing_smaller_than_what_may_be_clipped_has_a_depth_where_nothing_else_has() -> None:
    inverse = np.zeros((104, 184), np.float32)
    inverse[50:54, 10:14] = 0.5
    nearest, codes = read(insert_depth(JPEG, encode_depth(inverse)))
    assert nearest == 0.5
    assert codes[51:53, 11:13].min() > 200


def test_even_noise_fits_into_a_segment() -> None:
    noise = np.random.default_rng(0).random((104, 184), np.float32)
    assert read(insert_depth(JPEG, encode_depth(noise)))[1].shape == noise.shape
