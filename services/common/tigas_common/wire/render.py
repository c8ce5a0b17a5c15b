"""Messages between a client and the render service."""

from __future__ import annotations

import math
from dataclasses import asdict
from itertools import pairwise
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import AfterValidator, Field, field_validator, model_validator

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.model import MAX_PIXELS, MAX_SIDE, Angle, Entries, Point, Quaternion, Unit, WireModel

Value = TypeVar("Value")

FrameFormat = Literal["jpeg", "png", "yuv420p"]
"""Formats of every rasteriser."""
AnswerFormat = Literal[FrameFormat, "h264", "webp"]
"""Formats of independent images and, for `h264`, of frames that may refer to their predecessor."""
StillFormat = Literal["jpeg", "webp"]
"""Formats of frames in stateless mode."""
CongestionControl = Literal["westwood", "reno"]
"""Congestion control of HTTP/3: NewReno that tolerates random loss, or plain NewReno as in the paper."""
LadderName = Literal["scene", "paper"]
"""The ladder that profiles index: each scene's own, if it has one, or the paper's for all scenes."""


class Rung(WireModel):
    """One level of the quality ladder; its number is its index in the ladder, and 0 is the best."""

    name: str
    width: int = Field(ge=16, le=MAX_SIDE)
    """Pixels, at the reference aspect ratio; a viewport of another shape gets as many pixels in its own shape."""
    height: int = Field(ge=16, le=MAX_SIDE)
    quality: int = Field(ge=1, le=100)
    """JPEG quality."""
    expected_kb: float = Field(gt=0)
    """Expected size of a frame, in kilobytes (1000 bytes)."""
    psnr_db: float | None = None
    """Expected PSNR of a frame, enlarged to the display, against ground truth, in dB; null if not measured."""

    def size_for(self, width: int, height: int) -> tuple[int, int]:
        """Width and height in pixels for a viewport: the rung's number of pixels in the viewport's shape.

        A viewport with the rung's aspect ratio gets exactly the rung's resolution; pixels are square in every shape.
        """
        scale = math.sqrt(self.width * self.height / (width * height))
        return min(MAX_SIDE, max(1, round(width * scale))), min(MAX_SIDE, max(1, round(height * scale)))


MAX_OVERSCAN = 0.5
"""Maximum margin of a frame beyond each side of the viewport, as a share of the viewport's width or height."""

DEFAULT_LADDER = (
    Rung(name="High", width=1280, height=720, quality=90, expected_kb=240),
    Rung(name="Medium-High", width=960, height=540, quality=65, expected_kb=55),
    Rung(name="Medium-Low", width=640, height=360, quality=35, expected_kb=20),
    Rung(name="Low", width=320, height=180, quality=10, expected_kb=7),
)
"""The ladder of the paper."""


class VideoRequest(WireModel):
    """How to encode a view as the next frame of its session's video."""

    bitrate_kbps: int = Field(ge=10, le=200_000)
    """The bit rate of the video, key frames included, in kbit/s."""
    frames_per_s: float = Field(default=60, ge=1, le=240)
    """Number of frames per second that share the bit rate."""
    key: bool = False
    """Whether the answer must be a key frame, because the client cannot decode references to earlier frames."""


class RenderRequest(WireModel):
    """One view to render. The pose is either Euler angles and `translation`, or `position` and `quaternion`."""

    scene: str = Field(max_length=256)
    """The scene's id."""
    seq: int = Field(default=0, ge=0, lt=2**32)
    """The client's own number for this request; repeated in the answer."""

    azimuth: Angle | None = None
    """Degrees, positive to the right."""
    elevation: Angle | None = None
    """Degrees, positive upwards."""
    roll: Angle | None = None
    """Degrees, positive clockwise; 0 if left out."""
    translation: Point | None = None
    """The camera's centre in scene units, together with the angles."""
    position: Point | None = None
    """The camera's centre in scene units, together with `quaternion`."""
    quaternion: Quaternion | None = None
    """The rotation from camera to world, [x, y, z, w], of any length but zero."""

    fx: float = Field(gt=0, le=1e6)
    """The horizontal focal length, in pixels of the viewport."""
    fy: float = Field(gt=0, le=1e6)
    """The vertical focal length, in pixels of the viewport."""
    cx: float = Field(ge=-1e6, le=1e6)
    """The principal point's column, in pixels of the viewport."""
    cy: float = Field(ge=-1e6, le=1e6)
    """The principal point's row, in pixels of the viewport."""
    width: int = Field(ge=1, le=MAX_SIDE)
    """The viewport's width in pixels; width × height is at most 16,777,216."""
    height: int = Field(ge=1, le=MAX_SIDE)
    """The viewport's height in pixels."""

    profile: int | None = Field(default=None, ge=0, le=255)
    """Rung of the scene's ladder; if left out, the viewport's own resolution at the best rung's quality."""
    display_scale: float = Field(default=1, ge=1, le=64)
    """Linear scale at which the viewport shows the frame."""
    overscan: float = Field(default=0, ge=0, le=MAX_OVERSCAN)
    """The frame's margin beyond each side of the viewport, as a share of its width (left, right) and height (top,
    bottom), at the same pixels per angle."""
    depth: bool = False
    """Whether a JPEG or WebP carries a coarse depth map of the view; ignored for other formats."""
    detail: Literal["auto", "full"] = "auto"
    """How much of a large scene is drawn: as much as the frame's pixels can show, or all. PNGs show all."""
    coarse: bool = False
    """Whether a frame of the coarse scene is acceptable while the scene is loading. Otherwise, and for PNGs or full
    detail, the request waits."""
    format: AnswerFormat = "jpeg"
    """Format of the answer's body."""
    video: VideoRequest | None = None
    """Required for the format `h264`, and not allowed for others."""
    deadline_ms: float | None = Field(default=None, gt=0, le=60_000)
    """Time after arrival for which the frame is useful, in milliseconds; a later one is not sent."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        # no loops, as thousands of requests per second are validated
        euler = (self.azimuth, self.elevation, self.translation)
        quaternion = (self.position, self.quaternion)
        uses_euler = euler != (None, None, None) or self.roll is not None
        if uses_euler == (quaternion != (None, None)):
            raise ValueError("give either azimuth, elevation and translation, or position and quaternion")
        if None in (euler if uses_euler else quaternion):
            raise ValueError(
                "azimuth, elevation and translation go together"
                if uses_euler
                else "position and quaternion go together"
            )
        if self.width * self.height > MAX_PIXELS:
            raise ValueError(f"a viewport has at most {MAX_PIXELS} pixels")
        if (self.video is None) == (self.format == "h264"):
            raise ValueError("the format h264 and `video` go together")
        return self

    @classmethod
    def at(cls, scene: str, pose: Pose, intrinsics: Intrinsics, **options: Any) -> Self:
        """Request the view of a scene from a pose; `options` are further fields."""
        return cls(scene=scene, position=pose.position, quaternion=pose.quaternion, **asdict(intrinsics), **options)

    @property
    def pose(self) -> Pose:
        """The camera-to-world transform."""
        if self.position is not None and self.quaternion is not None:
            return Pose.from_quaternion(self.position, self.quaternion)
        assert self.azimuth is not None
        assert self.elevation is not None
        assert self.translation is not None
        return Pose.from_euler(self.azimuth, self.elevation, self.roll or 0.0, self.translation)

    @property
    def intrinsics(self) -> Intrinsics:
        """The intrinsics for the viewport."""
        return Intrinsics(self.fx, self.fy, self.cx, self.cy, self.width, self.height)


class ServerTiming(WireModel):
    """How the server spent its time, in milliseconds."""

    queue: float
    render: float
    encode: float


class VideoInfo(WireModel):
    """A frame's place in its session's video."""

    key: bool
    """Whether the frame can be decoded independently."""
    after: int | None
    """The `seq` of the frame to which this one refers, the video's previous one; null for a key frame."""
    codec: str
    """Such as `avc1.4d401f` (RFC 6381), for WebCodecs."""


class FrameHeader(WireModel):
    """Precedes the body on WebTransport. From status 400 on, the body is a Problem and the other fields are null."""

    status: int
    seq: int
    content_type: str
    width: int | None = None
    height: int | None = None
    margin_x: int | None = None
    """Number of the frame's columns beyond the viewport on the left, and the same on the right; null for none."""
    margin_y: int | None = None
    """Number of the frame's rows beyond the viewport at the top, and the same at the bottom; null for none."""
    profile: int | None = None
    coarse: bool | None = None
    """Whether the frame shows the coarse scene, because the scene is loading; null otherwise."""
    video: VideoInfo | None = None
    """For a frame of a video; its body is one access unit in Annex B's byte stream format (ITU-T H.264)."""
    timing: ServerTiming | None = None
    requests_per_s: float | None = None
    """Requests per second that this client may send from now on; null: as many as a display shows."""


class Problem(WireModel):
    """Why a request failed (RFC 9457, application/problem+json)."""

    type: str
    """Stable: `tigas:` followed by a name, such as `tigas:unknown-scene`."""
    title: str
    status: int
    detail: str


class StartCamera(WireModel):
    """The camera with which a visitor enters the scene."""

    position: Point
    look_at: Point


MAX_VIEWS = 100
MAX_PATHS = 20
"""Maximum number of views and of paths saved with a scene."""
MAX_KEYFRAMES = 64
"""Maximum number of keyframes in a path: as many as fit into a request."""


def _is_name(name: str) -> str:
    if name != name.strip() or not name.isprintable():
        raise ValueError("a name has only printable characters, and no spaces around them")
    return name


SavedName = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_is_name)]


class SavedView(WireModel):
    """A camera pose in the scene's own coordinates."""

    position: Point
    quaternion: Quaternion
    """Rotation from camera to world, [x, y, z, w]; stored normalised."""

    @field_validator("quaternion")
    @classmethod
    def _normalise(cls, quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        length = math.hypot(*quaternion)
        x, y, z, w = quaternion
        return x / length, y / length, z / length, w / length


class Keyframe(SavedView):
    """A pose on a camera path, with its time."""

    t_ms: float = Field(ge=0, le=3_600_000)


class SavedPath(WireModel):
    """A smooth camera path through keyframes."""

    keyframes: Entries[Keyframe]
    """Ordered by time."""
    easing: Literal["linear", "ease-in", "ease-out", "ease-in-out"] = "linear"
    """How the movement starts and ends."""
    loop: bool = False
    """Whether the path repeats; its last keyframe then has the pose of the first."""

    @model_validator(mode="after")
    def _check_keyframes(self) -> Self:
        if not 2 <= len(self.keyframes) <= MAX_KEYFRAMES:
            raise ValueError(f"a path has 2 to {MAX_KEYFRAMES} keyframes")
        if any(later.t_ms <= earlier.t_ms for earlier, later in pairwise(self.keyframes)):
            raise ValueError("every keyframe needs a greater t_ms than the previous one")
        first, last = self.keyframes[0], self.keyframes[-1]
        if self.loop and (first.position, first.quaternion) != (last.position, last.quaternion):
            raise ValueError("the last keyframe of a loop must have the pose of the first")
        return self


class SceneDownload(WireModel):
    """A downloadable form of the scene's Gaussians, for clients that render them.

    `compressed` is a single file, at `/scenes/{id}/download/compressed`, made on the first request; every prefix of it
    gives the best picture for its size. `streamed` is the levels of detail of a streamed SOG scene, file by file,
    starting with `/scenes/{id}/download/streamed/lod-meta.json`.
    """

    form: Literal["compressed", "streamed"] = "compressed"
    bytes: int | None = None
    """Size of the file; like the other fields, null until the file is made."""
    sha256: str | None = None
    """In hexadecimal; also the file's ETag."""
    gaussians: int | None = None


class SceneInfo(WireModel):
    """Facts about a scene. `camera` and `up` are known from its scene.json, or once it has been loaded."""

    id: str
    name: str
    state: Literal["unloaded", "loading", "loaded", "broken"]
    error: str | None
    """One sentence, if the state is `broken`."""
    progress: Unit | None = None
    """Share of the scene that has been read while the state is `loading`."""
    gaussians: int | None
    sh_degree: int | None
    file_bytes: int
    file_sha256: str | None = None
    """In hexadecimal; null until the file has been loaded once."""
    format: str | None = Field(default=None, max_length=100)
    """File format, for people: `PLY`, `SPZ 4`; null if it cannot be read."""
    antialiased: bool = False
    """Whether the Gaussians need Mip-Splatting's 2D filter, if the file says so."""
    memory_bytes: int
    """Memory in use; 0 unless loaded."""
    preview: str
    """URL of the preview, relative to the server's root."""
    up: Point
    camera: StartCamera | None
    background: tuple[Unit, Unit, Unit]
    """RGB, 0 to 1."""
    enhance: Literal["scene", "general"] | None = None
    """Networks that can enhance its frames: its own, trained on this file, or general ones for any scene."""
    ladder: Entries[Rung] | None = None
    """The scene's own ladder, which profiles index; null: the server's."""
    views: dict[SavedName, SavedView] = Field(default_factory=dict)
    """Saved views by name; empty in the list of all scenes, like `paths`."""
    paths: dict[SavedName, SavedPath] = Field(default_factory=dict)
    """Saved camera paths by name."""
    builtin: bool = False
    """Whether the scene is part of the service and can be neither renamed nor deleted."""
    downloads: Entries[SceneDownload] = ()
    """Downloadable forms, for rendering elsewhere; none if the scene is broken or the server offers none."""


class SceneName(WireModel):
    """New name of a scene."""

    name: str = Field(max_length=200)


class SceneEdit(WireModel):
    """Changes to a scene's description; fields left out are unchanged."""

    camera: StartCamera | None = None
    """New start view, in the scene's own coordinates."""
    up: Point | None = None
    """Direction that points up, of any length."""
    views: dict[SavedName, SavedView | None] = Field(default_factory=dict)
    """Views to save, by name; null removes one."""
    paths: dict[SavedName, SavedPath | None] = Field(default_factory=dict)
    """Camera paths to save, by name; null removes one."""

    @field_validator("camera", "up")
    @classmethod
    def _is_given(cls, value: Value) -> Value:
        if value is None:
            raise ValueError("it can be changed, but not removed")
        return value


class AddedScene(WireModel):
    """Result of an upload."""

    id: str


class Training(WireModel):
    """Progress of the training of a scene's networks."""

    state: Literal["idle", "running", "done", "failed"]
    progress: Unit = 0
    stage: str = ""
    """Current step."""
    problem: str | None = None
    """One sentence: why training failed, or why the scene's existing networks cannot be used."""


class ServerConfig(WireModel):
    """The server's configuration for the page (`/config.json`)."""

    version: str
    commit: str | None = None
    """Commit of the server's code, with `-dirty` if modified; null if unknown."""
    device: str | None = None
    """Rendering device: `cpu`, or the GPU's name."""
    ladder: Entries[Rung]
    """Ladder of scenes without their own."""
    certificate_sha256: str | None
    """Base64 of the SHA-256 of the certificate's DER, for `serverCertificateHashes`."""
    public_key_sha256: str | None = None
    """Base64 of the SHA-256 of its public key, for Chromium's `--ignore-certificate-errors-spki-list`."""
    webtransport_url: str | None
    """URL of the WebTransport session, for the address under which the page was opened."""
    https_url: str | None
    """URL of the page in a secure context, for other devices on the network."""
    services: dict[str, str]
    """Other services by name, such as `dash`, with their base URLs."""
    dash_h3_url: str | None = None
    """Base URL of the service `dash` over HTTP/3, for browsers that trust the certificate; null if not offered."""
    retry_after_s: float | None = None
    """If the server is full, the seconds after which a new viewer may try again; null if it takes new viewers."""
    host: str | None = None
    """In a cluster, the name of the host that serves the requested scene; null outside a cluster."""
    render_url: str | None = None
    """Base URL for `POST /render`; null: the page's own origin."""
    max_upload_bytes: int | None = None
    """Maximum size of a file that a page may add as a scene; null: pages cannot add, rename or delete scenes."""
    has_scene: bool | None = None
    """Whether the requested scene exists; null if none was requested, and in a cluster."""
    formats: Entries[StillFormat] = ("jpeg",)
    """Preferred image formats. Others work too, but cost this server more than they gain."""
    congestion_control: CongestionControl | None = None
    """Congestion control of WebTransport and HTTP/3; null if neither is offered, and from older services."""
    tcp_congestion_control: str | None = None
    """The kernel's congestion control for HTTP/1.1, and so for DASH, such as `cubic`; null if unknown."""
    why_no_training: str | None = None
    """One sentence: why scenes' networks cannot be trained here; null if they can."""


class HostLoad(WireModel):
    """A service's load and configuration, for a cluster's director (`/api/load`)."""

    config: ServerConfig
    """Like `/config.json`, for the name under which the host was reached. `retry_after_s` is set if it is full."""
    viewers: int = Field(ge=0)
    utilisation: Unit
    """Utilisation of the busier part: the edges together, or the renderer."""
    queue_age_s: float = Field(ge=0)
    """The longest wait anywhere in the last second."""
    scenes: Entries[str]
    """Ids of loaded scenes."""
