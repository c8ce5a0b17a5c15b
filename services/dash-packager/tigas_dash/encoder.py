"""H.264 with no delay: every frame that goes in comes out at once."""

from __future__ import annotations

from fractions import Fraction
from typing import Literal

import av
from av.video.frame import PictureType

from tigas_dash.cmaf.chunk import Sample
from tigas_dash.cmaf.header import BT709, ParameterSets
from tigas_dash.errors import EncoderUnavailable
from tigas_dash.h264 import parameter_sets, to_sample
from tigas_dash.representation import Representation

EncoderName = Literal["libx264", "h264_nvenc"]
_OPTIONS: dict[EncoderName, dict[str, str]] = {
    "libx264": {
        "preset": "ultrafast",
        "tune": "zerolatency",
        "forced-idr": "1",
        "x264-params": "scenecut=0:sliced-threads=0:colorprim=bt709:transfer=bt709:colormatrix=bt709:range=tv",
    },
    "h264_nvenc": {"preset": "p1", "tune": "ull", "rc": "cbr", "zerolatency": "1", "delay": "0", "forced-idr": "1"},
}
BUFFER_S = 0.25
"""The rate is held over this long (the VBV buffer): a keyframe is no longer a burst than that, in seconds."""


class Encoder:
    """One representation's encoder. Not for several threads at a time."""

    def __init__(self, name: EncoderName, representation: Representation, frame_rate: int) -> None:
        """Raises EncoderUnavailable."""
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
            self.parameters: ParameterSets = parameter_sets(codec.extradata or b"")
        except (av.FFmpegError, ValueError) as error:
            raise EncoderUnavailable(
                f"{name} cannot encode {representation.width}×{representation.height}: {error}."
            ) from None

    def encode(self, frame: av.VideoFrame, number: int, *, keyframe: bool) -> Sample:
        """One frame. Raises av.FFmpegError, and ValueError if the encoder does not answer with exactly one frame."""
        frame.pts = number
        frame.time_base = self._codec.time_base
        frame.pict_type = PictureType.I if keyframe else PictureType.NONE
        packets = self._codec.encode(frame)
        if len(packets) != 1:
            raise ValueError(f"the encoder gave {len(packets)} frames for one")
        return Sample(to_sample(bytes(packets[0])), packets[0].is_keyframe)


def choose_encoder() -> EncoderName:
    """NVIDIA's encoder where it really works, else x264."""
    probe = Representation(0, 640, 360, 1000)
    try:
        frame = av.VideoFrame(640, 360, "yuv420p")
        Encoder("h264_nvenc", probe, 30).encode(frame, 0, keyframe=True)
    except (av.FFmpegError, EncoderUnavailable, ValueError):
        return "libx264"
    return "h264_nvenc"
