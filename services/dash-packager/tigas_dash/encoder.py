"""H.264 encoding without delay: one rendered frame in, one encoded frame of every representation out."""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import av
import numpy as np
from av.video.frame import PictureType
from av.video.reformatter import Interpolation, VideoReformatter

from tigas_common.errors import StartError
from tigas_dash.cmaf import BT709, ParameterSets, Sample
from tigas_dash.errors import EncoderUnavailable
from tigas_dash.representation import Representation

logger = logging.getLogger(__name__)

EncoderName = Literal["libx264", "h264_nvenc"]
_OPTIONS: dict[EncoderName, dict[str, str]] = {
    "libx264": {
        "preset": "superfast",
        "tune": "zerolatency",
        "forced-idr": "1",
        "x264-params": "scenecut=0:sliced-threads=0:colorprim=bt709:transfer=bt709:colormatrix=bt709:range=tv",
    },
    "h264_nvenc": {"preset": "p1", "tune": "ull", "rc": "cbr", "zerolatency": "1", "delay": "0", "forced-idr": "1"},
}
BUFFER_S = 0.25
"""Duration in seconds over which the bitrate is enforced (the VBV buffer), which limits the burst of a keyframe."""
_START_CODE = re.compile(rb"\x00\x00\x00?\x01")
_SEI, _SPS, _PPS, _DELIMITER = 6, 7, 8, 9
"""Types of NAL units (ITU-T H.264, 7.4.1)."""


@dataclass(frozen=True, slots=True)
class RawFrame:
    data: bytes
    """I420: planar yuv420p in BT.709, limited range, without padding."""
    width: int
    height: int
    pose: int
    """Number of the pose that it shows."""

    def video_frame(self) -> av.VideoFrame:
        """A copy as an FFmpeg frame."""
        planes = np.frombuffer(self.data, np.uint8).reshape(self.height * 3 // 2, self.width)
        return av.VideoFrame.from_ndarray(planes, format="yuv420p")


class Encoder:
    """The encoder of one representation. Not thread-safe."""

    def __init__(self, name: EncoderName, representation: Representation, frame_rate: int) -> None:
        """Open the encoder. Raises EncoderUnavailable."""
        codec = av.CodecContext.create(name, "w")
        assert isinstance(codec, av.VideoCodecContext)
        codec.width, codec.height, codec.pix_fmt = representation.width, representation.height, "yuv420p"
        codec.time_base, codec.framerate = Fraction(1, frame_rate), Fraction(frame_rate)
        bits = representation.bitrate_kbps * 1000
        codec.bit_rate = bits
        codec.gop_size = 2**20  # keyframes are requested explicitly
        codec.max_b_frames = 0
        codec.thread_count = 1
        codec.color_primaries = codec.color_trc = codec.colorspace = BT709
        codec.color_range = 1  # limited
        codec.flags |= av.codec.context.Flags.global_header
        codec.options = _OPTIONS[name] | {"maxrate": str(bits), "bufsize": str(int(bits * BUFFER_S))}
        self._codec = codec
        try:
            codec.open()
            self.parameters: ParameterSets = _parameter_sets(codec.extradata or b"")
        except (av.FFmpegError, ValueError) as error:
            raise EncoderUnavailable(
                f"{name} cannot encode {representation.width}×{representation.height}: {_describe(error)}."
            ) from None

    def encode(self, frame: av.VideoFrame, number: int, *, keyframe: bool) -> Sample:
        """Encode one frame. Raises av.FFmpegError, and ValueError unless the encoder returns exactly one frame."""
        frame.pts = number
        frame.time_base = self._codec.time_base
        frame.pict_type = PictureType.I if keyframe else PictureType.NONE
        packets = self._codec.encode(frame)
        if len(packets) != 1:
            raise ValueError(f"the encoder returned {len(packets)} frames for one")
        return Sample(_to_sample(bytes(packets[0])), packets[0].is_keyframe)


class LadderEncoder:
    """The encoders of all representations: the largest has the size of rendered frames, and others are scaled from it.

    Not thread-safe.
    """

    def __init__(
        self, name: EncoderName, ladder: Sequence[Representation], frame_rate: int, keyframe_every: int
    ) -> None:
        """Open all encoders. Raises EncoderUnavailable."""
        self._name = name
        self._ladder = ladder
        self._frame_rate = frame_rate
        self._keyframe_every = keyframe_every
        self._encoders = self._open()
        self._reformatter = VideoReformatter()
        self._scaled: tuple[RawFrame, list[av.VideoFrame]] | None = None
        self.failures = 0
        self.parameters = [encoder.parameters for encoder in self._encoders]
        """Parameter sets of each representation."""

    def encode(self, frame: RawFrame, number: int) -> list[Sample]:
        """Encode frame `number` of the stream, once for each representation.

        If an encoder fails, all are replaced and the stream continues with a keyframe. Raises EncoderUnavailable if
        that fails too.
        """
        images = self._scale(frame)
        keyframe = number % self._keyframe_every == 0
        try:
            return self._encode(images, number, keyframe)
        except (av.FFmpegError, ValueError) as error:
            self.failures += 1
            logger.warning("The encoder failed at frame %d and is replaced: %s", number, error)
        self._encoders = self._open()
        if [encoder.parameters for encoder in self._encoders] != self.parameters:
            raise EncoderUnavailable("The encoder failed, and its replacement does not fit the stream.")
        try:
            return self._encode(images, number, True)
        except (av.FFmpegError, ValueError) as error:
            raise EncoderUnavailable(f"The encoder failed twice for the same frame: {error}.") from None

    def _encode(self, images: Sequence[av.VideoFrame], number: int, keyframe: bool) -> list[Sample]:
        pairs = zip(self._encoders, images, strict=True)
        return [encoder.encode(image, number, keyframe=keyframe) for encoder, image in pairs]

    def _open(self) -> list[Encoder]:
        return [Encoder(self._name, representation, self._frame_rate) for representation in self._ladder]

    def _scale(self, frame: RawFrame) -> list[av.VideoFrame]:
        """The frame at every resolution; a repeated frame is not scaled again."""
        if self._scaled is None or self._scaled[0] is not frame:
            whole = frame.video_frame()
            images = [
                whole
                if (one.width, one.height) == (frame.width, frame.height)
                else self._reformatter.reformat(whole, one.width, one.height, interpolation=Interpolation.AREA)
                for one in self._ladder
            ]
            self._scaled = frame, images
        return self._scaled[1]


def choose_encoder(wanted: EncoderName | Literal["auto"]) -> EncoderName:
    """The wanted encoder; `auto` is NVIDIA's if it works, else x264. Raises StartError if the wanted one fails."""
    if wanted == "libx264":
        return wanted
    try:
        frame = av.VideoFrame(640, 360, "yuv420p")
        Encoder("h264_nvenc", Representation(0, 640, 360, 1000), 30).encode(frame, 0, keyframe=True)
    except (av.FFmpegError, EncoderUnavailable, ValueError) as error:
        if wanted == "auto":
            return "libx264"
        raise StartError(f"h264_nvenc does not work here ({_describe(error)}); choose libx264 or auto.") from None
    return "h264_nvenc"


def _describe(error: Exception) -> str:
    return (isinstance(error, av.FFmpegError) and error.strerror) or str(error).removesuffix(".")


def _nal_units(stream: bytes) -> Iterator[tuple[int, bytes]]:
    """Type and bytes of each NAL unit in a byte stream (ITU-T H.264, annex B)."""
    for unit in _START_CODE.split(stream)[1:]:
        if unit:
            yield unit[0] & 0x1F, unit


def _parameter_sets(stream: bytes) -> ParameterSets:
    """The first parameter sets in a byte stream. Raises ValueError if there are none."""
    found = dict(reversed(list(_nal_units(stream))))
    if _SPS not in found or _PPS not in found:
        raise ValueError("the encoder returned no parameter sets")
    return ParameterSets(found[_SPS], found[_PPS])


def _to_sample(stream: bytes) -> bytes:
    """A frame for an `mdat`, with lengths instead of start codes and without the init segment's parameter sets."""
    units = (unit for kind, unit in _nal_units(stream) if kind not in (_SEI, _SPS, _PPS, _DELIMITER))
    return b"".join(struct.pack(">I", len(unit)) + unit for unit in units)
