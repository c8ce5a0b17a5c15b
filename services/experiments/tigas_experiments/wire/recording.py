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
"""A longer recording is refused."""
LONGEST_REPLY_MS = 600_000.0
"""Maximum time from a frame's request to its last byte."""
PlayedMode = Literal["stateless", "video", "dash", "webrtc", "side-by-side", "local"]


class Input(WireModel):
    """A pose that the rig sampled, because it differs from the one before, or should have sampled."""

    at: float
    pose: int = Field(ge=0)
    """Its number, increasing with each change. A missed pose has the number of the next sampled one, which also
    shows it.
    """
    missed: bool = False
    """The page stalled in a frame of the display in which the movement went on."""
    position: Point
    quaternion: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    """Camera to world, [x, y, z, w], in the scene's own frame."""

    @property
    def camera(self) -> Pose:
        """Raises ValueError if the quaternion is zero."""
        return Pose.from_quaternion(self.position, self.quaternion)


class ShownFrame(WireModel):
    """A frame that was on the screen."""

    side: Literal["stateless", "dash", "webrtc", "local"]
    """Frames requested by the page in the modes `stateless` and `video`, frames of a stream, or frames rendered by the
    page.
    """
    at: float
    """When it was on the screen."""
    pose: int
    """Number of the pose at which its pixels were requested."""
    view: int | None = Field(default=None, ge=0)
    """Number of the pose to which the page warped it; None without a warp."""
    filled: float | None = Field(default=None, ge=0, le=1)
    """The page's estimate of the share of the picture that the newest frame did not cover; None where not turned."""
    warp_ms: float | None = Field(default=None, ge=0)
    """How long turning it kept the page's main thread; None where not turned."""
    latencies: Entries[float]
    """The page's own measurement of the latency of each input first shown by this frame."""
    rung: int | None
    """Of the ladder."""
    width: int = Field(ge=0, le=MAX_SIDE)
    height: int = Field(ge=0, le=MAX_SIDE)
    shown_width: int | None = Field(default=None, ge=0, le=MAX_SIDE)
    shown_height: int | None = Field(default=None, ge=0, le=MAX_SIDE)
    """Pixels, as the page showed it after enhancing it; None where it was not enhanced."""
    enhance_ms: float | None = Field(default=None, ge=0)
    """How long that took the page's graphics processor."""


class Reply(WireModel):
    """A frame received in the modes `stateless` and `video`, shown or not. Superseded requests have none."""

    at: float
    """Arrival of its last byte."""
    asked_at: float
    first_byte_at: float
    pose: int
    """The number of the pose that it was rendered from."""
    asked_rung: int | None
    """Of the ladder; None if the server was to choose."""
    rung: int | None
    """Its rung."""
    bytes: int = Field(ge=0, le=MAX_BYTES)
    server: ServerTiming | None
    """Where the server's time went."""
    throughput_kbps: float | None = Field(ge=0)
    """The page's estimate of the link after this reply; None while unknown."""

    @property
    def time_ms(self) -> float:
        """From the request to the last byte."""
        return self.at - self.asked_at

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.asked_at <= self.first_byte_at <= self.at <= self.asked_at + LONGEST_REPLY_MS:
            raise ValueError("the times of a reply must follow one another, within ten minutes")
        return self


Fate = Literal["shown", "overtaken", "cancelled", "dropped", "unanswered"]
"""Outcome of a request: its frame was shown; it arrived after a newer one; the page cancelled it, since a newer one was
on screen; the server shed it, or it was lost; nothing had arrived by the recording's end.
"""


class Request(WireModel):
    """A request of the mode `stateless` or `video`, and its outcome."""

    at: float
    """When it was sent."""
    pose: int
    asked_rung: int | None
    """Of the ladder; None if the server was to choose."""
    fate: Fate


class Capture(WireModel):
    """The screen at a tick of the run's clock, with its picture kept."""

    at: float
    """The first animation frame at or after the tick."""
    shown_at: float
    """Time at which the frame appeared on screen; negative before the run."""
    pose: int
    """The pose at which its pixels were requested."""
    view: int | None = Field(default=None, ge=0)
    """The pose to which the page warped it; None without a warp."""
    filled: float | None = Field(default=None, ge=0, le=1)
    """As of a shown frame."""
    rung: int | None
    width: int = Field(gt=0, le=MAX_SIDE)
    height: int = Field(gt=0, le=MAX_SIDE)


class Sample(WireModel):
    """A kept frame of the mode `stateless`: the JPEG as received and, with enhancement, as shown."""

    seq: int = Field(ge=0, lt=2**32)
    """Number of the request, which identifies the parts of a sample."""
    at: float
    """When it was on the screen."""
    request: RenderRequest
    """The exact request, to be repeated."""
    rung: int | None = Field(ge=0, le=255)
    """Its rung."""
    bytes: int = Field(ge=0, le=MAX_BYTES)
    """Of the JPEG."""
    restore: str = Field(default="off", max_length=100)
    """The model that restored it, or `off`, as for a rung that a network leaves alone."""
    upscale: str = Field(default="off", max_length=100)
    enhance_ms: float | None = Field(default=None, ge=0)
    """Time of both models; None if both were off, or unmeasured."""
    width: int = Field(gt=0, le=MAX_SIDE)
    height: int = Field(gt=0, le=MAX_SIDE)
    """Size of the shown picture in pixels."""
    enhanced: bool = False
    """Whether the shown picture was kept as well, without loss."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.request.seq != self.seq:
            raise ValueError("a sample has its request's sequence number")
        if self.request.format != "jpeg":
            raise ValueError("only JPEGs are sampled")
        return self


class Lens(WireModel):
    """The viewport and its intrinsics, in its pixels."""

    width: int = Field(ge=1, le=MAX_SIDE)
    height: int = Field(ge=1, le=MAX_SIDE)
    fx: float = Field(gt=0)
    fy: float = Field(gt=0)
    cx: float
    cy: float

    @property
    def intrinsics(self) -> Intrinsics:
        """As everything that computes takes them."""
        return Intrinsics(self.fx, self.fy, self.cx, self.cy, self.width, self.height)


class Traffic(WireModel):
    """Bytes received by the page so far."""

    at: float
    bytes: int = Field(ge=0)
    """Of frames or segments, since the run's start; headers of the transport are not in it."""


class PlayedStream(StreamInfo):
    """The stream of the modes with DASH, as made by the packager, and its player."""

    player: str = Field(max_length=100)
    """Its name and version."""
    targets_ms: Entries[float] = ()
    """The live latency that it was to hold during the run; each target that was in force, in their order."""
    protocols: Entries[str] = ()
    """Protocols of its segments (ALPN, as `nextHopProtocol` of Resource Timing); none in early recordings."""

    @property
    def summary(self) -> str:
        """All of it in one line."""
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
    """As RTP names it: H264 or VP8."""
    rung: int
    width: int
    height: int
    frame_rate: int
    lost_packets: int
    """Packets of the video lost since the stream was opened."""


class PlayedDownload(WireModel):
    """Download and rendering of the scene in the mode `local`. Times in ms; None: it never happened."""

    form: Literal["compressed", "streamed", "ply"]
    """`ply` only in earlier records."""
    renderer: str | None = Field(max_length=100)
    """The renderer, such as `WebGL 2`."""
    began_ms: float
    """When the download began, since the run's start: below 0 if it began before the run."""
    first_picture_ms: float | None = Field(ge=0)
    """From then until some of the scene was on the screen."""
    complete_ms: float | None = Field(ge=0)
    """From then until all of it was on the screen; all that the view needs, if streamed."""
    downloaded_bytes: int = Field(ge=0)
    """Of the scene's files, by the run's end."""
    bytes: int = Field(ge=0)
    """Bytes of the file; 0 if the server never announced them, or if streamed."""
    gaussians: int | None = Field(ge=0)
    """Gaussians of the scene; None if that never became known."""


class RecordingHead(WireModel):
    """All but the long lists."""

    scene: str
    mode: PlayedMode
    transport: str | None
    """Transport of the frames: the page's, or `dash`."""
    dash: PlayedStream | None = None
    """None without DASH, before it played, and in early recordings."""
    webrtc: PlayedWebRtc | None = None
    """Only of the mode `webrtc`."""
    local: PlayedDownload | None = None
    """Only of the mode `local`."""
    user_agent: str
    lens: Lens
    started_unix_ms: float
    """The run's start, on the machine's clock."""
    duration_ms: float = Field(gt=0)
    """How long the movement lasts."""
    ended_ms: float = Field(ge=0)
    """End of the recording: the last view was on screen, or the wait for it timed out."""
    complete: bool
    """The movement was played to its end."""
    hidden: bool
    """The page was hidden at some time, so that a browser may have held frames back."""
    display_interval_ms: float | None = Field(default=None, gt=0)
    """Between two frames of the display; unknown of early recordings."""


class Recording(RecordingHead):
    """One run, as the viewer saw it."""

    inputs: Entries[Input]
    frames: Entries[ShownFrame]
    replies: Entries[Reply] = ()
    """None of DASH."""
    requests: Entries[Request] = ()
    """None of DASH, and of early recordings."""
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
        """Without the lists."""
        return RecordingHead.model_validate(self.model_dump(include=set(RecordingHead.model_fields)))


class LinkSample(WireModel):
    """The link at one moment of a run."""

    at: float
    """ms since the run's start."""
    position_ms: float | None
    """Of the trace."""
    target_kbps: float
    delivered_kbps: float
    queue_ms: float
    drops: int
    up_delivered_kbps: float
