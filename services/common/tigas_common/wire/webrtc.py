"""Messages between the packager and the viewers of a WebRTC stream, in addition to WebRTC itself."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from tigas_common.wire.dash import StreamRequest
from tigas_common.wire.model import WireModel

MAX_SDP = 65_536
"""The longest offer, in characters; Chromium's for one video and one data transport has about 7000."""
POSES = "poses"
"""Data channel for the page's camera, as PoseUpdates: unordered, without retransmission."""
FRAMES = "frames"
"""Data channel for the pose of each frame, as SentFrames from the packager: unordered, reliable."""


class WebRtcRequest(StreamRequest):
    """An offer to receive one video, on one transport with the data channels `poses` and `frames`."""

    sdp: str = Field(min_length=1, max_length=MAX_SDP)
    frame_rate: Literal[30, 60] = 30
    """H.264 has 30 only."""
    rung: int | None = Field(default=None, ge=0, le=255)
    """The rung of the scene's ladder with the video's size; by default the largest that fits into the viewport."""
    bitrate_kbps: int | None = Field(default=None, ge=100, le=100_000)
    """Maximum rate of the encoder on any link; 10 Mbit/s by default."""


class WebRtcSession(WireModel):
    """A session that was opened; `DELETE /sessions/{id}` ends it."""

    id: str
    sdp: str
    """The answer, with all candidates: no more follow."""
    codec: str
    """As RTP names it: H264 or VP8."""
    rung: int
    width: int
    height: int
    """Pixels; even."""
    frame_rate: int


class SentFrame(WireModel):
    """Which pose a frame of the video shows."""

    rtp_timestamp: int
    """Of its packets, as `requestVideoFrameCallback` gives it: 90 kHz, modulo 2³²."""
    pose: int
    """The `seq` of the pose that it was rendered from."""
