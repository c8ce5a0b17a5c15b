"""H.264 for one viewer: each image is output immediately, as a key frame or predicted from the previous image.

A frame gets its share of the bit rate and hardly more, even if it is a key frame, because a coarse frame in time is
worth more to a viewer than a fine frame that is late. x264 therefore keeps a constant rate, with a buffer (VBV) of two
frames. The buffer, and with it the highest rate, is fixed when an encoder is opened; rates down to half of the highest
do not need a new encoder.
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
"""Smaller than `ultrafast` at equal quality in about the same time; slower presets gain nothing (docs/streams.md)."""
PROFILE: Final = "main"
"""Has better entropy coding than `baseline`, and is supported by all decoders."""
FRAMES_PER_S: Final = 60
"""Nominal frame rate of the rate control, for all viewers: only the bits per frame matter."""
MIN_BITS, MAX_BITS = 1_000.0, 25_000_000.0
"""Limits of the bits per frame, within x264's range."""
HEADROOM: Final = 1.25
"""Ratio of an encoder's highest rate to its initial rate."""
RATE_RANGE: Final = 2.0
"""Ratio of an encoder's highest rate to its lowest rate."""
BUFFER_FRAMES: Final = 2.0
"""Size of the buffer, in frames at the highest rate. x264 spends about half of the buffer on a frame."""
BUFFER_BITS_PER_PIXEL: Final = 0.15
"""Minimum size of the buffer; with less, a key frame is blurred and takes half a second to become sharp."""

_X264: Final = (
    "scenecut=0:sliced-threads=0:keyint=infinite:ref=1:bframes=0:rc-lookahead=0:force-cfr=1"
    ":colorprim=bt709:transfer=bt709:colormatrix=bt709:range=tv"
)
_BT709: Final = 1
_LIMITED: Final = 1
_START_CODE: Final = re.compile(rb"\x00\x00\x00?\x01")
_SEI, _SPS = 6, 7


class EncodingFailed(TigasError):
    """The encoder returned no frame."""


class EncodedFrame(NamedTuple):
    """An encoded frame of the video."""

    body: bytes
    """One access unit in the byte stream format of Annex B; a key frame begins with its parameter sets."""
    codec: str
    """Codec string, such as `avc1.4d401f` (RFC 6381)."""


class H264Encoder:
    """Encodes images of one size. Not thread-safe."""

    def __init__(self, width: int, height: int, bits: float) -> None:
        """width, height: even numbers. bits: initial bits per frame. Raises EncodingFailed."""
        self.width, self.height = width, height
        self._max_bits = HEADROOM * _clamp_bits(bits)
        self._number = 0
        self.codec = ""
        """Codec string, known after the first frame."""
        codec = av.CodecContext.create("libx264", "w")
        assert isinstance(codec, av.VideoCodecContext)
        codec.width, codec.height, codec.pix_fmt = width, height, "yuv420p"
        codec.time_base, codec.framerate = Fraction(1, FRAMES_PER_S), Fraction(FRAMES_PER_S)
        codec.bit_rate = max_rate = _rate(self._max_bits)  # equal to `maxrate`, for a constant rate even after changes
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
            "maxrate": str(max_rate),
            "bufsize": str(round(max(self._max_bits * BUFFER_FRAMES, width * height * BUFFER_BITS_PER_PIXEL))),
            "x264-params": _X264,
        }
        self._context = codec
        try:
            codec.open()
        except (av.FFmpegError, ValueError) as error:
            raise EncodingFailed(f"H.264 cannot be encoded at {width}×{height}: {error}.") from None

    def fits(self, width: int, height: int, bits: float) -> bool:
        """Whether this encoder can continue with images of this size and this number of bits per frame."""
        is_in_range = self._max_bits / RATE_RANGE <= _clamp_bits(bits) <= self._max_bits
        return (width, height) == (self.width, self.height) and is_in_range

    def encode(self, planes: bytes, bits: float, *, key: bool) -> EncodedFrame:
        """Encode planes from `encode_yuv420p` to about this number of bits. The first frame is always a key frame.

        Raises EncodingFailed; the encoder must not be used after that.
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
            # without SEI, which has x264's name and settings in 700 bytes
            body = b"".join(b"\0\0\0\1" + unit for unit in units if unit[0] & 0x1F != _SEI)
        return EncodedFrame(body, self.codec)


def nal_units(stream: bytes) -> Iterator[bytes]:
    """Split a byte stream into its NAL units, without start codes."""
    return (unit for unit in _START_CODE.split(stream)[1:] if unit)


def _clamp_bits(bits: float) -> float:
    return min(max(bits, MIN_BITS), MAX_BITS)


def _rate(bits: float) -> int:
    """Bits per second, rounded to thousands like x264's rates."""
    return round(_clamp_bits(bits) * FRAMES_PER_S / 1000) * 1000
