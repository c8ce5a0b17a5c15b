"""The viewer's record of a run, and the shaper's record of its link.

All times are milliseconds since the run's start, on the page's own clock.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal, Self

from pydantic import Field, model_validator

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.dash import StreamInfo
from tigas_common.wire.model import MAX_SIDE, Coordinate, Entries, Point, WireModel
from tigas_common.wire.render import RenderRequest, ServerTiming

MAX_BYTES = 256_000_000
"""Maximum size of a recording."""
LONGEST_REPLY_MS = 600_000.0
"""Maximum time from a frame's request to its last byte."""
PlayedMode = Literal["stateless", "video", "dash", "webrtc", "side-by-side", "local"]


class Input(WireModel):
    """A pose sampled by the rig because it changed, or one that the rig should have sampled."""

    at: float
    pose: int = Field(ge=0)
    """Number of the pose, increasing with each change. A missed pose has the number of the next sampled one, which also
    shows it.
    """
    missed: bool = False
    """Whether the page stalled in a display frame during which the movement continued."""
    position: Point
    quaternion: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    """Camera to world, [x, y, z, w], in the scene's own frame."""

    @property
    def camera(self) -> Pose:
        """The camera's pose. Raises ValueError if the quaternion is zero."""
        return Pose.from_quaternion(self.position, self.quaternion)


class ShownFrame(WireModel):
    """A frame that was on screen."""

    side: Literal["stateless", "dash", "webrtc", "local"]
    """Frames requested by the page in the modes `stateless` and `video`, frames of a stream, or frames rendered by the
    page.
    """
    at: float
    """Time at which it was on screen."""
    pose: int
    """Number of the pose for which its pixels were requested."""
    view: int | None = Field(default=None, ge=0)
    """Number of the pose to which the page reprojected it; None without reprojection."""
    filled: float | None = Field(default=None, ge=0, le=1)
    """The page's estimate of the share of the picture outside the newest frame; None without reprojection."""
    warp_ms: float | None = Field(default=None, ge=0)
    """Time for which reprojection occupied the page's main thread; None without reprojection."""
    latencies: Entries[float]
    """The page's own measurement of the latency of each input first shown by this frame."""
    rung: int | None
    """Rung of the ladder."""
    width: int = Field(ge=0, le=MAX_SIDE)
    height: int = Field(ge=0, le=MAX_SIDE)
    shown_width: int | None = Field(default=None, ge=0, le=MAX_SIDE)
    shown_height: int | None = Field(default=None, ge=0, le=MAX_SIDE)
    """Size in pixels as shown after enhancement; None without enhancement."""
    enhance_ms: float | None = Field(default=None, ge=0)
    """GPU time of the enhancement."""


class Reply(WireModel):
    """A frame received in the modes `stateless` and `video`, shown or not. Superseded requests have none."""

    at: float
    """Arrival of its last byte."""
    asked_at: float
    first_byte_at: float
    pose: int
    """Number of the pose for which it was rendered."""
    asked_rung: int | None
    """Requested rung of the ladder; None to let the server choose."""
    rung: int | None
    """Rung of the frame."""
    bytes: int = Field(ge=0, le=MAX_BYTES)
    server: ServerTiming | None
    """How the server spent its time."""
    throughput_kbps: float | None = Field(ge=0)
    """The page's estimate of the link's rate after this reply; None while unknown."""

    @property
    def time_ms(self) -> float:
        """Time from the request to the last byte."""
        return self.at - self.asked_at

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.asked_at <= self.first_byte_at <= self.at <= self.asked_at + LONGEST_REPLY_MS:
            raise ValueError("the times of a reply must follow one another, within ten minutes")
        return self


Fate = Literal["shown", "overtaken", "cancelled", "dropped", "unanswered"]
"""Outcome of a request: its frame was shown; it arrived after a newer one; the page cancelled it, as a newer one was on
screen; the server shed it, or it was lost; nothing had arrived by the recording's end.
"""


class Request(WireModel):
    """A request in the mode `stateless` or `video`, and its outcome."""

    at: float
    """Time at which it was sent."""
    pose: int
    asked_rung: int | None
    """Requested rung of the ladder; None to let the server choose."""
    fate: Fate


class Capture(WireModel):
    """The screen at a tick of the run's clock, kept as a picture."""

    at: float
    """Time of the first animation frame at or after the tick."""
    shown_at: float
    """Time at which the frame appeared on screen; negative before the run."""
    pose: int
    """Number of the pose for which its pixels were requested."""
    view: int | None = Field(default=None, ge=0)
    """Number of the pose to which the page reprojected it; None without reprojection."""
    filled: float | None = Field(default=None, ge=0, le=1)
    """As in ShownFrame."""
    rung: int | None
    width: int = Field(gt=0, le=MAX_SIDE)
    height: int = Field(gt=0, le=MAX_SIDE)


class Sample(WireModel):
    """A kept frame of the mode `stateless`: the JPEG as received and, with enhancement, as shown."""

    seq: int = Field(ge=0, lt=2**32)
    """Sequence number of the request, which identifies the parts of a sample."""
    at: float
    """Time at which it was on screen."""
    request: RenderRequest
    """The exact request, for repeating it."""
    rung: int | None = Field(ge=0, le=255)
    """Rung of the frame."""
    bytes: int = Field(ge=0, le=MAX_BYTES)
    """Size of the JPEG."""
    restore: str = Field(default="off", max_length=100)
    """Model that restored it, or `off`, also for rungs without a network."""
    upscale: str = Field(default="off", max_length=100)
    enhance_ms: float | None = Field(default=None, ge=0)
    """Time of both models; None if both were off, or if unknown."""
    width: int = Field(gt=0, le=MAX_SIDE)
    height: int = Field(gt=0, le=MAX_SIDE)
    """Size of the shown picture in pixels."""
    enhanced: bool = False
    """Whether the shown picture was also kept, losslessly."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.request.seq != self.seq:
            raise ValueError("a sample has its request's sequence number")
        if self.request.format != "jpeg":
            raise ValueError("only JPEGs are sampled")
        return self


class Lens(WireModel):
    """The viewport and its intrinsics, in pixels."""

    width: int = Field(ge=1, le=MAX_SIDE)
    height: int = Field(ge=1, le=MAX_SIDE)
    fx: float = Field(gt=0)
    fy: float = Field(gt=0)
    cx: float
    cy: float

    @property
    def intrinsics(self) -> Intrinsics:
        """The intrinsics as used in computations."""
        return Intrinsics(self.fx, self.fy, self.cx, self.cy, self.width, self.height)


class Traffic(WireModel):
    """Bytes received by the page so far."""

    at: float
    bytes: int = Field(ge=0)
    """Bytes of frames or segments since the run's start, without transport headers."""


class PlayedStream(StreamInfo):
    """The stream of a DASH mode, as made by the packager, and its player."""

    player: str = Field(max_length=100)
    """Name and version of the player."""
    targets_ms: Entries[float] = ()
    """Target live latencies during the run, in order."""
    protocols: Entries[str] = ()
    """Protocols of its segments (ALPN, as `nextHopProtocol` of Resource Timing); empty in early recordings."""

    @property
    def summary(self) -> str:
        """Summary in one line."""
        representations = ", ".join(
            f"{one.width}×{one.height} at {one.bitrate_kbps} kbit/s ({one.codecs})" for one in self.representations
        )
        over = f" over {' and '.join(self.protocols)}" if self.protocols else ""
        targets = ", then ".join(f"{target:g}" for target in self.targets_ms or (self.target_latency_ms,))
        return (
            f"{self.player}{over}; {self.frame_rate} frames/s, segments of {self.segment_s:g} s, chunks of "
            f"{self.frames_per_chunk}, target {targets} ms; {representations}"
        )


class PlayedWebRtc(WireModel):
    """Statistics of WebRTC."""

    codec: str
    """RTP name of the codec: H264 or VP8."""
    rung: int
    width: int
    height: int
    frame_rate: int
    lost_packets: int
    """Packets of the video lost since the stream was opened."""


class PlayedDownload(WireModel):
    """Download and rendering of the scene in the mode `local`. Times in ms; None if something never happened."""

    form: Literal["compressed", "streamed", "ply"]
    """`ply` only in earlier records."""
    renderer: str | None = Field(max_length=100)
    """The renderer, such as `WebGL 2`."""
    began_ms: float
    """Start of the download since the run's start, negative if it began before the run."""
    first_picture_ms: float | None = Field(ge=0)
    """Time from there until part of the scene was on screen."""
    complete_ms: float | None = Field(ge=0)
    """Time from there until the whole scene was on screen or, if streamed, everything that the view needs."""
    downloaded_bytes: int = Field(ge=0)
    """Bytes of the scene's files downloaded by the run's end."""
    bytes: int = Field(ge=0)
    """Size of the file; 0 if the server never announced it, or if streamed."""
    gaussians: int | None = Field(ge=0)
    """Number of Gaussians in the scene; None if it never became known."""


class RecordingHead(WireModel):
    """A recording without its long lists."""

    scene: str
    mode: PlayedMode
    transport: str | None
    """Transport of the frames: the page's, or `dash`."""
    dash: PlayedStream | None = None
    """None without DASH, if it never played, and in early recordings."""
    webrtc: PlayedWebRtc | None = None
    """Only in the mode `webrtc`."""
    local: PlayedDownload | None = None
    """Only in the mode `local`."""
    user_agent: str
    lens: Lens
    started_unix_ms: float
    """Start of the run, on the machine's clock."""
    duration_ms: float = Field(gt=0)
    """Duration of the movement."""
    ended_ms: float = Field(ge=0)
    """End of the recording: the last view was on screen, or the wait for it timed out."""
    complete: bool
    """Whether the movement was played to its end."""
    hidden: bool
    """Whether the page was hidden at some time, so that the browser may have delayed frames."""
    display_interval_ms: float | None = Field(default=None, gt=0)
    """Interval between display frames; unknown in early recordings."""


class Recording(RecordingHead):
    """One run, as seen by the viewer."""

    inputs: Entries[Input]
    frames: Entries[ShownFrame]
    replies: Entries[Reply] = ()
    """Empty for DASH."""
    requests: Entries[Request] = ()
    """Empty for DASH and in early recordings."""
    captures: Entries[Capture]
    traffic: Entries[Traffic]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if any(later.pose < earlier.pose + (not earlier.missed) for earlier, later in pairwise(self.inputs)):
            raise ValueError("the numbers of poses must increase")
        for name in ("inputs", "frames", "replies", "requests", "traffic"):
            times = [entry.at for entry in getattr(self, name)]
            if any(later < earlier for earlier, later in pairwise(times)):
                raise ValueError(f"the times of {name} must not go back")
        return self

    @property
    def head(self) -> RecordingHead:
        """The recording without its lists."""
        return RecordingHead.model_validate(self.model_dump(include=set(RecordingHead.model_fields)))


class LinkSample(WireModel):
    """The link at one moment of a run."""

    at: float
    """ms since the run's start."""
    position_ms: float | None
    """Position in the trace."""
    target_kbps: float
    delivered_kbps: float
    queue_ms: float
    drops: int
    up_delivered_kbps: float
