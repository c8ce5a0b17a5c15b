"""H.264 for one viewer: each input picture is output at once, as a key frame or predicted from the previous one.

A frame gets its share of the bit rate and hardly more, including key frames: a coarse one that arrives at once is worth
more to a viewer than a fine one that is late. For that x264 keeps a constant rate, with a buffer (VBV) of two frames.
The buffer is fixed when an encoder is opened, and with it the highest rate; rates down to half of it need no new
encoder.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from typing import Final, NamedTuple

import av
import numpy as np
from av.video.frame import PictureType

from tigas_common.errors import TigasError

PRESET: Final = "superfast"
"""Smaller than `ultrafast` at equal quality for about the same time; slower ones gain nothing (docs/streams.md)."""
PROFILE: Final = "main"
"""Its entropy coding is better than that of `baseline`, and every decoder knows it."""
FRAMES_PER_S: Final = 60
"""Nominal frame rate of the rate control, for any viewer: only the bits of a frame matter."""
LEAST_BITS, MOST_BITS = 1_000.0, 25_000_000.0
"""In a frame, so that x264 can count with them."""
HEADROOM: Final = 1.25
"""How much higher than the rate at first an encoder's highest rate is."""
RANGE: Final = 2.0
"""How many times the rate may be below the highest."""
BUFFER_FRAMES: Final = 2.0
"""Frames' shares at the highest rate that the buffer holds: x264 spends about half of its contents on a frame …"""
BUFFER_BITS_PER_PIXEL: Final = 0.15
"""… and its minimum: with less, a key frame is a smear that takes half a second to get sharp."""

_X264: Final = (
    "scenecut=0:sliced-threads=0:keyint=infinite:ref=1:bframes=0:rc-lookahead=0:force-cfr=1"
    ":colorprim=bt709:transfer=bt709:colormatrix=bt709:range=tv"
)
_BT709: Final = 1
_LIMITED: Final = 1
_START_CODE: Final = re.compile(rb"\x00\x00\x00?\x01")
_SEI, _SPS = 6, 7


class EncodingFailed(TigasError):
    """The encoder gave no frame."""


class Encoded(NamedTuple):
    """A picture in the video."""

    body: bytes
    """One access unit in Annex B's byte stream format; a key frame begins with its parameter sets."""
    codec: str
    """Such as `avc1.4d401f` (RFC 6381)."""


class H264Encoder:
    """Encodes pictures of one size. Not for several threads at a time."""

    def __init__(self, width: int, height: int, bits: float) -> None:
        """width, height: even; bits: in a frame, at first. Raises EncodingFailed."""
        self.width, self.height = width, height
        self._most = HEADROOM * _counted(bits)
        self._number = 0
        self.codec = ""
        """Known once there was a frame."""
        codec = av.CodecContext.create("libx264", "w")
        assert isinstance(codec, av.VideoCodecContext)
        codec.width, codec.height, codec.pix_fmt = width, height, "yuv420p"
        codec.time_base, codec.framerate = Fraction(1, FRAMES_PER_S), Fraction(FRAMES_PER_S)
        codec.bit_rate = most = _rate(self._most)  # equal to `maxrate`: a constant rate, even after changes
        codec.gop_size = 2**20  # key frames are requested explicitly
        codec.max_b_frames = 0
        codec.thread_count = 1
        codec.color_primaries = codec.color_trc = codec.colorspace = _BT709
        codec.color_range = _LIMITED
        codec.options = {
            "preset": PRESET,
            "tune": "zerolatency",
            "profile": PROFILE,
            "forced-idr": "1",
            "maxrate": str(most),
            "bufsize": str(round(max(self._most * BUFFER_FRAMES, width * height * BUFFER_BITS_PER_PIXEL))),
            "x264-params": _X264,
        }
        self._context = codec
        try:
            codec.open()
        except (av.FFmpegError, ValueError) as error:
            raise EncodingFailed(f"H.264 cannot be encoded at {width}×{height}: {error}.") from None

    def fits(self, width: int, height: int, bits: float) -> bool:
        """Whether it can continue with pictures of this size and this number of bits per frame."""
        is_in_range = self._most / RANGE <= _counted(bits) <= self._most
        return (width, height) == (self.width, self.height) and is_in_range

    def encode(self, planes: bytes, bits: float, *, key: bool) -> Encoded:
        """Encode a picture in the form of `encode_yuv420p` to about this many bits. The first is always a key frame.

        Raises EncodingFailed; the encoder's earlier output is then no longer referenced.
        """
        rows = np.frombuffer(planes, np.uint8).reshape(self.height * 3 // 2, self.width)
        frame = av.VideoFrame.from_ndarray(rows, format="yuv420p")
        frame.pts, frame.time_base = self._number, self._context.time_base
        frame.pict_type = PictureType.I if key else PictureType.NONE
        self._number += 1
        rate = _rate(bits)
        if rate != self._context.bit_rate:
            self._context.bit_rate = rate
        try:
            packets = self._context.encode(frame)
        except (av.FFmpegError, ValueError) as error:
            raise EncodingFailed(f"H.264 could not be encoded: {error}.") from None
        if len(packets) != 1:
            raise EncodingFailed(f"The H.264 encoder returned {len(packets)} frames for one.")
        body = bytes(packets[0])
        if packets[0].is_keyframe:
            units = list(nal_units(body))
            self.codec = next(f"avc1.{unit[1:4].hex()}" for unit in units if unit[0] & 0x1F == _SPS)
            # x264's name and settings, 700 bytes
            body = b"".join(b"\0\0\0\1" + unit for unit in units if unit[0] & 0x1F != _SEI)
        return Encoded(body, self.codec)


def nal_units(stream: bytes) -> Iterator[bytes]:
    """The NAL units of a byte stream, without their start codes."""
    return (unit for unit in _START_CODE.split(stream)[1:] if unit)


def _counted(bits: float) -> float:
    return min(max(bits, LEAST_BITS), MOST_BITS)


def _rate(bits: float) -> int:
    """Bits a second, as x264 counts them: in thousands."""
    return round(_counted(bits) * FRAMES_PER_S / 1000) * 1000
