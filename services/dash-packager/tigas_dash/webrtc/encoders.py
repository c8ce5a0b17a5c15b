"""aiortc's encoders, for streams limited to a bit rate regardless of the link."""

from __future__ import annotations

from aiortc import RTCRtpSender
from aiortc.codecs.h264 import H264Encoder
from aiortc.codecs.vpx import Vp8Encoder


class _Bounded:
    """Before one of aiortc's encoders in the order of base classes."""

    most_bps: int

    @property
    def target_bitrate(self) -> int:
        """As congestion control has it, up to the bound."""
        wanted: int = super().target_bitrate  # type: ignore[misc]
        return min(wanted, self.most_bps)

    @target_bitrate.setter
    def target_bitrate(self, bitrate: int) -> None:
        super(_Bounded, type(self)).target_bitrate.__set__(self, bitrate)  # type: ignore[misc]


class _BoundedH264(_Bounded, H264Encoder):
    pass


class _BoundedVp8(_Bounded, Vp8Encoder):
    pass


def bound(sender: RTCRtpSender, codec: str, most_bps: int) -> None:
    """Install such an encoder in a sender, before its first frame."""
    encoder = _BoundedH264() if codec == "H264" else _BoundedVp8()
    encoder.most_bps = most_bps
    vars(sender)["_RTCRtpSender__encoder"] = encoder
