"""H.264 for one viewer: a frame for each picture, of about the requested size, predicted from the last one."""

from __future__ import annotations

import av
import numpy as np
import pytest

from tests.render.raster.views import psnr
from tigas_render.encode.h264 import EncodedFrame, H264Encoder, nal_units
from tigas_render.encode.images import encode_yuv420p

WIDTH, HEIGHT = 192, 108
SPS, PPS = 7, 8
_RANDOM = np.random.default_rng(0)
_COARSE = np.kron(_RANDOM.integers(0, 200, (50, 60, 3)), np.ones((8, 8, 1)))
_WORLD = (_COARSE + _RANDOM.integers(0, 56, _COARSE.shape)).astype(np.uint8)


def picture(number: int, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    """A moving view: noise of two scales, which is expensive to encode."""
    at = 3 * number % 64
    return encode_yuv420p(np.ascontiguousarray(_WORLD[at : at + height, 2 * at : 2 * at + width]))


def decoded(frames: list[EncodedFrame]) -> list[av.VideoFrame]:
    """Each frame from an independent decoder, at once."""
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(decoder, av.VideoCodecContext)
    decoder.thread_count = 1
    pictures = [decoder.decode(av.Packet(frame.body)) for frame in frames]
    assert [len(found) for found in pictures] == [1] * len(frames)
    return [found[0] for found in pictures]


def test_each_picture_can_be_shown_at_once_and_is_the_one_that_went_in() -> None:
    encoder = H264Encoder(WIDTH, HEIGHT, 120_000)
    frames = [encoder.encode(picture(number), 150_000, key=number == 3) for number in range(6)]
    for number, shown in enumerate(decoded(frames)):
        assert (shown.width, shown.height) == (WIDTH, HEIGHT)
        assert psnr(shown.to_ndarray().astype(np.uint8).ravel(), np.frombuffer(picture(number), np.uint8)) > 30


def test_only_key_frames_have_parameter_sets_and_nothing_has_comments() -> None:
    encoder = H264Encoder(WIDTH, HEIGHT, 20_000)
    frames = [encoder.encode(picture(number), 50_000, key=number == 2) for number in range(4)]
    kinds = [[unit[0] & 0x1F for unit in nal_units(frame.body)] for frame in frames]
    assert kinds == [[SPS, PPS, 5], [1], [SPS, PPS, 5], [1]]
    assert {frame.codec for frame in frames} == {f"avc1.{next(nal_units(frames[0].body))[1:4].hex()}"}
    assert frames[0].codec.startswith("avc1.4d40")


@pytest.mark.parametrize("bits", [10_000, 40_000])
def test_no_frame_is_much_larger_than_its_share_not_even_a_key_frame(bits: int) -> None:
    encoder = H264Encoder(WIDTH, HEIGHT, bits)
    sizes = [8 * len(encoder.encode(picture(n), bits, key=n % 10 == 9).body) for n in range(40)]
    assert max(sizes) < 2.2 * bits
    assert np.mean(sizes) == pytest.approx(bits, rel=0.35)


def test_another_rate_needs_no_new_encoder_down_to_half_of_it() -> None:
    encoder = H264Encoder(WIDTH, HEIGHT, 40_000)
    means = []
    for bits in (40_000, 26_000, 40_000):
        assert encoder.fits(WIDTH, HEIGHT, bits)
        means.append(np.mean([8 * len(encoder.encode(picture(n), bits, key=False).body) for n in range(40)]))
    assert means[1] < 0.8 * means[0]
    assert means[2] > 1.2 * means[1]
    assert not encoder.fits(WIDTH, HEIGHT, 20_000)
    assert not encoder.fits(WIDTH, HEIGHT, 80_000)
    assert not encoder.fits(WIDTH, HEIGHT + 2, 40_000)


@pytest.mark.parametrize(("width", "height"), [(16, 16), (192, 18), (34, 256)])
@pytest.mark.parametrize("bits", [1, 1e9])
def test_every_size_and_rate_that_may_be_asked_for_gives_a_picture(width: int, height: int, bits: float) -> None:
    encoder = H264Encoder(width, height, bits)
    planes = picture(0, width, height)
    assert len(decoded([encoder.encode(planes, bits, key=False), encoder.encode(planes, bits, key=False)])) == 2
