"""Picture quality: known answers, and invalid pictures."""

from __future__ import annotations

import io
import math
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from tests.experiments.made_up import png
from tests.experiments.triplets_made_up import jpeg, view
from tigas_experiments.quality.picture import MAX_PSNR_DB, BrokenPicture, compare, decode


def test_equal_pictures() -> None:
    picture = decode(png())
    quality = compare(picture, picture)
    assert quality.psnr_db == MAX_PSNR_DB
    assert quality.ssim == pytest.approx(1)


def test_psnr_of_a_known_error() -> None:
    truth = np.full((32, 32, 3), 100, np.uint8)
    assert compare(truth + np.uint8(10), truth).psnr_db == pytest.approx(10 * math.log10(255**2 / 100))


def test_ssim_falls_with_structure_and_not_with_a_shift_of_brightness() -> None:
    random = np.random.default_rng(1)
    truth = random.integers(60, 190, (64, 64, 3), np.uint8)
    noise = np.clip(truth + random.integers(-40, 41, truth.shape), 0, 255).astype(np.uint8)
    assert compare(truth + np.uint8(20), truth).ssim > 0.95
    assert compare(noise, truth).ssim < 0.9


def test_a_smaller_frame_is_shown_as_large_as_the_viewport() -> None:
    truth = decode(png(width=128, height=72))
    small = np.asarray(Image.fromarray(truth).resize((64, 36), Image.Resampling.BOX))
    assert compare(small, truth).psnr_db > 30


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\nrubbish", png()[:60], b"GIF89a"])
def test_what_is_no_picture(data: bytes) -> None:
    with pytest.raises(BrokenPicture, match="cannot be read"):
        decode(data)


def test_a_picture_of_too_many_pixels() -> None:
    buffer = io.BytesIO()
    Image.new("1", (8192, 4096)).save(buffer, "PNG")
    with pytest.raises(BrokenPicture, match="8192×4096"):
        decode(buffer.getvalue())


@pytest.mark.parametrize("side", [12_000, 30_000])
def test_a_picture_that_pillow_itself_takes_for_a_bomb(side: int) -> None:
    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", len(header)) + b"IHDR" + header + struct.pack(">I", zlib.crc32(b"IHDR" + header))
    with pytest.raises(BrokenPicture, match="pixels"):
        decode(b"\x89PNG\r\n\x1a\n" + chunk + struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT")))


def test_psnr_and_ssim_fall_as_compression_grows() -> None:
    truth = view()
    found = [compare(picture, truth) for picture in (truth, *(decode(jpeg(truth, q)) for q in (95, 70, 40, 15, 3)))]
    for values in ([quality.psnr_db for quality in found], [quality.ssim for quality in found]):
        assert values == sorted(values, reverse=True)
        assert len(set(values)) == 6
