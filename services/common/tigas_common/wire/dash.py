"""Messages between the packager and the viewers of its streams, DASH and WebRTC."""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import Field, model_validator

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.model import MAX_PIXELS, MAX_SIDE, Entries, Point, Quaternion, WireModel

MAX_REPRESENTATIONS = 8
MAX_SDP = 65_536
"""Maximum length of an offer in characters; Chromium's, with one video and one data transport, has about 7000."""
POSES = "poses"
"""Data channel for the page's camera, as PoseUpdates: unordered, without retransmission."""
FRAMES = "frames"
"""Data channel for the pose of each frame, sent as SentFrames by the packager: unordered, reliable."""


class RepresentationRequest(WireModel):
    """One representation that a session wants."""

    rung: int = Field(ge=0, le=255)
    """Rung of the render service's ladder with this resolution."""
    bitrate_kbps: int | None = Field(default=None, ge=50, le=100_000)
    """If left out, derived from the resolution and the frame rate."""

    def __str__(self) -> str:
        return f"r{self.rung}" + (f"-{self.bitrate_kbps}" if self.bitrate_kbps is not None else "")


class StreamRequest(WireModel):
    """A stream of one scene for one viewer, over any transport."""

    scene: str = Field(max_length=256)
    position: Point
    """The first pose: the camera's centre, in scene units."""
    quaternion: Quaternion
    """Camera to world, [x, y, z, w]."""
    fx: float = Field(gt=0, le=1e6)
    fy: float = Field(gt=0, le=1e6)
    cx: float = Field(ge=-1e6, le=1e6)
    cy: float = Field(ge=-1e6, le=1e6)
    width: int = Field(ge=16, le=MAX_SIDE)
    height: int = Field(ge=16, le=MAX_SIDE)
    """fx, fy, cx and cy are in pixels of this viewport."""
    frame_rate: int = Field(default=30, ge=1, le=60)
    """Frames a second."""

    @model_validator(mode="after")
    def _check_viewport(self) -> Self:
        if self.width * self.height > MAX_PIXELS:
            raise ValueError(f"a viewport has at most {MAX_PIXELS} pixels")
        return self

    @property
    def intrinsics(self) -> Intrinsics:
        """The intrinsics for the viewport."""
        return Intrinsics(self.fx, self.fy, self.cx, self.cy, self.width, self.height)


class SessionRequest(StreamRequest):
    """A DASH stream for one viewer."""

    representations: Entries[RepresentationRequest] | None = Field(
        default=None, min_length=1, max_length=MAX_REPRESENTATIONS
    )
    """By default, every rung that fits into the viewport, and the best of them at three times the bitrate as well."""
    segment_s: float = Field(default=1.0, ge=0.2, le=10)
    """Duration of a segment, which is also the interval between keyframes."""
    frames_per_chunk: int = Field(default=1, ge=1, le=600)
    target_latency_ms: int = Field(default=200, ge=50, le=10_000)
    """Latency that players should keep behind the newest pose."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.frames_per_chunk > self.frames_per_segment:
            raise ValueError(f"a chunk cannot have more frames than a segment ({self.frames_per_segment})")
        return self

    @property
    def frames_per_segment(self) -> int:
        """Frames in a segment: a whole number, so that segments and keyframes coincide."""
        return max(1, math.floor(self.segment_s * self.frame_rate + 0.5))


class PoseUpdate(WireModel):
    """The viewer's newest pose. The intrinsics may change with it; they are for the session's viewport."""

    seq: int = Field(ge=0, lt=2**32)
    """The viewer's own number for this pose."""
    position: Point
    quaternion: Quaternion
    fx: float | None = Field(default=None, gt=0, le=1e6)
    fy: float | None = Field(default=None, gt=0, le=1e6)
    cx: float | None = Field(default=None, ge=-1e6, le=1e6)
    cy: float | None = Field(default=None, ge=-1e6, le=1e6)

    @property
    def pose(self) -> Pose:
        """The camera-to-world transform."""
        return Pose.from_quaternion(self.position, self.quaternion)


class FrameShown(WireModel):
    """The pose that a frame of the stream shows: maps media time to poses."""

    frame: int
    """Counted from 0."""
    media_time_s: float
    """Start of the frame on the media timeline, in seconds."""
    pose: int
    """The `seq` of the pose from which the frame was rendered."""


class RepresentationInfo(WireModel):
    """One representation of a session."""

    id: str
    """Rung and kilobits per second, such as r2-1414."""
    rung: int
    width: int
    height: int
    """Pixels; even, as yuv420p requires."""
    bitrate_kbps: int
    codecs: str
    """Codecs parameter of RFC 6381."""


class StreamInfo(WireModel):
    """Description of a stream."""

    representations: Entries[RepresentationInfo]
    frame_rate: int
    segment_s: float
    frames_per_chunk: int
    target_latency_ms: int


class SessionInfo(StreamInfo):
    """A session that was opened; paths are relative to the packager's root."""

    id: str
    manifest: str
    poses: str
    """Path of the WebSocket that takes PoseUpdates and sends FrameShown."""


class SessionStatus(WireModel):
    """Status of a session."""

    id: str
    scene: str
    age_s: float
    frames: int
    """Frames in the stream so far."""
    repeated: int
    """Frames that repeat the previous one, because no new one was ready in time."""
    dropped: int
    """Frames that were skipped to keep up with the clock; others last longer instead."""
    poses: int
    """Pose updates received."""
    render_failures: int
    """Requests that the render service did not answer with a frame."""
    render_problem: str | None
    """Reason why the render service sends no frames at present, in one sentence."""
    encoder_failures: int
    watchers: int
    """Open pose sockets."""


class WebRtcRequest(StreamRequest):
    """An offer to receive one video, on one transport with the data channels `poses` and `frames`."""

    sdp: str = Field(min_length=1, max_length=MAX_SDP)
    frame_rate: Literal[30, 60] = 30
    """With H.264, 30 only."""
    rung: int | None = Field(default=None, ge=0, le=255)
    """Rung of the scene's ladder with the video's size; by default the largest that fits into the viewport."""
    bitrate_kbps: int | None = Field(default=None, ge=100, le=10_000)
    """Maximum rate of the encoder on any link; 10 Mbit/s by default."""


class WebRtcSession(WireModel):
    """A session that was opened; `DELETE /sessions/{id}` ends it."""

    id: str
    sdp: str
    """The answer, complete with all candidates."""
    codec: str
    """RTP name of the codec: H264 or VP8."""
    rung: int
    width: int
    height: int
    """Pixels; even."""
    frame_rate: int


class SentFrame(WireModel):
    """The pose that a frame of the video shows."""

    rtp_timestamp: int
    """Timestamp of its packets, as reported by `requestVideoFrameCallback`: 90 kHz, modulo 2³²."""
    pose: int
    """The `seq` of the pose from which the frame was rendered."""
