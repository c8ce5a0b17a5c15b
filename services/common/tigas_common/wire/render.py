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
"""Formats of an independent picture, or, for `h264`, of one that may refer to its predecessor."""
StillFormat = Literal["jpeg", "webp"]
"""Formats of frames in the stateless mode."""
CongestionControl = Literal["westwood", "reno"]
"""Congestion control of HTTP/3: NewReno that tolerates random loss, or plain NewReno as in the paper."""
LadderName = Literal["scene", "paper"]
"""The ladder that profiles index: each scene's own, if it has one, or the paper's for all."""


class Rung(WireModel):
    """One level of the quality ladder; its number is its place in the ladder, 0 the best."""

    name: str
    width: int = Field(ge=16, le=MAX_SIDE)
    """Pixels, at the reference aspect ratio: a viewport of another shape gets as many pixels in its own shape."""
    height: int = Field(ge=16, le=MAX_SIDE)
    quality: int = Field(ge=1, le=100)
    """JPEG quality."""
    expected_kb: float = Field(gt=0)
    """Expected size of a frame, in kilobytes (1000 bytes)."""
    psnr_db: float | None = None
    """Expected PSNR of a frame that is enlarged to the display against ground truth, in dB, where it was measured."""

    def size_for(self, width: int, height: int) -> tuple[int, int]:
        """Width and height in pixels for a viewport: the rung's own number of pixels in the viewport's own shape.

        A viewport with the rung's aspect ratio gets exactly the rung's resolution; pixels are square in every shape.
        """
        scale = math.sqrt(self.width * self.height / (width * height))
        return min(MAX_SIDE, max(1, round(width * scale))), min(MAX_SIDE, max(1, round(height * scale)))


MAX_OVERSCAN = 0.5
"""The most that a frame shows beyond each side of the viewport, as a share of the viewport's width or height."""

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
    """The number of frames per second that share the bit rate."""
    key: bool = False
    """Whether the answer must be a key frame, because the client cannot decode references to earlier frames."""


class RenderRequest(WireModel):
    """One view to render. The pose is either Euler angles and `translation`, or `position` and `quaternion`."""

    scene: str = Field(max_length=256)
    """The scene's id."""
    seq: int = Field(default=0, ge=0, lt=2**32)
    """The client's own number for this request; the answer repeats it."""

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
    """The rung of the scene's ladder; if left out, the viewport's own resolution at the best rung's quality."""
    display_scale: float = Field(default=1, ge=1, le=64)
    """Linear scale at which the viewport shows the frame."""
    overscan: float = Field(default=0, ge=0, le=MAX_OVERSCAN)
    """The margin that the frame shows beyond each side of the viewport, as a share of its width (left, right) and
    height (top, bottom), at the same pixels per angle."""
    depth: bool = False
    """Whether a JPEG or WebP carries a coarse depth of the view; ignored for other formats."""
    detail: Literal["auto", "full"] = "auto"
    """How much of a large scene is drawn: what the frame's pixels can show, or everything; PNGs show everything."""
    coarse: bool = False
    """Whether a frame of the coarse scene will do while the scene is loading; otherwise, and for a PNG or the full
    detail, the request waits."""
    format: AnswerFormat = "jpeg"
    """The format of the answer's body."""
    video: VideoRequest | None = None
    """Required for the format `h264`, and allowed for no other."""
    deadline_ms: float | None = Field(default=None, gt=0, le=60_000)
    """How long after its arrival the frame is still useful, in milliseconds; a later one is not sent."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        # without loops, as thousands a second are checked
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
        """The view of a scene from a pose; the options are further fields."""
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
    """Where the server's time went, in milliseconds."""

    queue: float
    render: float
    encode: float


class VideoInfo(WireModel):
    """A frame's place in its session's video."""

    key: bool
    """Whether it can be decoded independently."""
    after: int | None
    """The `seq` of the frame that it refers to, the last one of the video; null for a key frame."""
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
    """Number of the frame's columns beyond the viewport at the left, equal to that at the right; null for none."""
    margin_y: int | None = None
    """The same of its rows, at the top and at the bottom."""
    profile: int | None = None
    coarse: bool | None = None
    """Whether it shows the coarse scene, because the scene is loading; null otherwise."""
    video: VideoInfo | None = None
    """Of a frame of a video; its body is one access unit in Annex B's byte stream format (ITU-T H.264)."""
    timing: ServerTiming | None = None
    requests_per_s: float | None = None
    """How many requests a second this client may send from now on; null: as many as a display shows."""


class Problem(WireModel):
    """Why a request failed (RFC 9457, application/problem+json)."""

    type: str
    """Stable: `tigas:` and a name, such as `tigas:unknown-scene`."""
    title: str
    status: int
    detail: str


class StartCamera(WireModel):
    """Where a visitor enters the scene."""

    position: Point
    look_at: Point


MAX_VIEWS = 100
MAX_PATHS = 20
"""The most views and paths that are saved with a scene."""
MAX_KEYFRAMES = 64
"""The most keyframes of a path: as many as a request has room for."""


def _is_name(name: str) -> str:
    if name != name.strip() or not name.isprintable():
        raise ValueError("a name has only printable characters, and no spaces around them")
    return name


SavedName = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_is_name)]


class SavedView(WireModel):
    """A camera pose in the scene's own coordinates."""

    position: Point
    quaternion: Quaternion
    """The rotation from camera to world, [x, y, z, w]; kept with length one."""

    @field_validator("quaternion")
    @classmethod
    def _normalise(cls, quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        length = math.hypot(*quaternion)
        x, y, z, w = quaternion
        return x / length, y / length, z / length, w / length


class Keyframe(SavedView):
    """A pose of a camera path and its time."""

    t_ms: float = Field(ge=0, le=3_600_000)


class SavedPath(WireModel):
    """A smooth camera path through keyframes."""

    keyframes: Entries[Keyframe]
    """In the order of time."""
    easing: Literal["linear", "ease-in", "ease-out", "ease-in-out"] = "linear"
    """How it begins and ends."""
    loop: bool = False
    """Whether it plays again and again; its last keyframe has the pose of the first then."""

    @model_validator(mode="after")
    def _check_keyframes(self) -> Self:
        if not 2 <= len(self.keyframes) <= MAX_KEYFRAMES:
            raise ValueError(f"a path has 2 to {MAX_KEYFRAMES} keyframes")
        if any(later.t_ms <= earlier.t_ms for earlier, later in pairwise(self.keyframes)):
            raise ValueError("every keyframe needs a greater t_ms than the one before")
        first, last = self.keyframes[0], self.keyframes[-1]
        if self.loop and (first.position, first.quaternion) != (last.position, last.quaternion):
            raise ValueError("the last keyframe of a loop has the pose of the first")
        return self


class SceneDownload(WireModel):
    """A form of the scene's Gaussians for clients that draw them.

    `compressed` is one file, at `/scenes/{id}/download/compressed`, made on the first request; every prefix of it
    gives the best picture of its size. `streamed` are the levels of detail of a streamed SOG scene, file by file, from
    `/scenes/{id}/download/streamed/lod-meta.json` on.
    """

    form: Literal["compressed", "streamed"] = "compressed"
    bytes: int | None = None
    """The file's length; null until it was made, as are the others."""
    sha256: str | None = None
    """In hexadecimal digits; also its ETag."""
    gaussians: int | None = None


class SceneInfo(WireModel):
    """Facts about a scene, loaded or not; `camera` and `up` are known once it was loaded, or from its scene.json."""

    id: str
    name: str
    state: Literal["unloaded", "loading", "loaded", "broken"]
    error: str | None
    """One sentence, when the state is `broken`."""
    progress: Unit | None = None
    """How much of it has been read, while the state is `loading`."""
    gaussians: int | None
    sh_degree: int | None
    file_bytes: int
    file_sha256: str | None = None
    """In hexadecimal digits; null until the file was loaded once."""
    format: str | None = Field(default=None, max_length=100)
    """Of the file, for people: `PLY`, `SPZ 4`; null if it cannot be read."""
    antialiased: bool = False
    """Whether its Gaussians need Mip-Splatting's 2D filter, if the file says so."""
    memory_bytes: int
    """Its present memory; 0 unless loaded."""
    preview: str
    """The preview's URL, relative to the server's root."""
    up: Point
    camera: StartCamera | None
    background: tuple[Unit, Unit, Unit]
    """RGB, 0 to 1."""
    enhance: Literal["scene", "general"] | None = None
    """Networks that can enhance its frames: its own, trained on this very file, or those for any scene."""
    ladder: Entries[Rung] | None = None
    """The ladder that profiles index if the scene has its own; null: the server's."""
    views: dict[SavedName, SavedView] = Field(default_factory=dict)
    """Saved views by name; left out in the list of all scenes, as are paths."""
    paths: dict[SavedName, SavedPath] = Field(default_factory=dict)
    """Saved camera paths by name."""
    builtin: bool = False
    """Whether it is part of the service, which can neither rename nor delete it."""
    downloads: Entries[SceneDownload] = ()
    """Downloadable forms, to be rendered elsewhere; none if it is broken or the server offers none."""


class SceneName(WireModel):
    """New name of a scene."""

    name: str = Field(max_length=200)


class SceneEdit(WireModel):
    """Changes of a scene's description; whatever is left out stays."""

    camera: StartCamera | None = None
    """New start view, in the scene's own coordinates."""
    up: Point | None = None
    """Direction that points up; it need not have length one."""
    views: dict[SavedName, SavedView | None] = Field(default_factory=dict)
    """Views to save by name; null removes one."""
    paths: dict[SavedName, SavedPath | None] = Field(default_factory=dict)
    """Camera paths to save by name; null removes one."""

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
    """How far the training of a scene's networks is."""

    state: Literal["idle", "running", "done", "failed"]
    progress: Unit = 0
    stage: str = ""
    """Its present step."""
    problem: str | None = None
    """One sentence: why it failed, or why the networks that the scene has cannot be used."""


class ServerConfig(WireModel):
    """The server's configuration for the page (`/config.json`)."""

    version: str
    commit: str | None = None
    """Of its code, with `-dirty` if that was changed; null if it is unknown."""
    device: str | None = None
    """Its rendering device: `cpu`, or the GPU's name."""
    ladder: Entries[Rung]
    """Ladder of scenes without their own."""
    certificate_sha256: str | None
    """Base64 of the SHA-256 of the certificate's DER, for `serverCertificateHashes`."""
    public_key_sha256: str | None = None
    """The same of its public key, for Chromium's `--ignore-certificate-errors-spki-list`."""
    webtransport_url: str | None
    """Where to open the WebTransport session, fitted to the address that the page was opened under."""
    https_url: str | None
    """The same page as a secure context, for other devices on the network."""
    services: dict[str, str]
    """Other services by name, such as `dash`, with their base URLs."""
    dash_h3_url: str | None = None
    """Base URL of the service `dash` over HTTP/3, for browsers that trust the certificate; null: it is not offered."""
    retry_after_s: float | None = None
    """The server is full: seconds after which a new viewer may try again. Null if it takes new viewers."""
    host: str | None = None
    """In a cluster, the name of the host that serves the scene which was asked about; null: there is only this one."""
    render_url: str | None = None
    """Base URL for `POST /render`; null: the page's own origin."""
    max_upload_bytes: int | None = None
    """Maximum size of a file that a page may add as a scene; null: it may add, rename and delete none."""
    has_scene: bool | None = None
    """Whether there is the scene that was asked about; null if none was, and in a cluster."""
    formats: Entries[StillFormat] = ("jpeg",)
    """Preferred formats of pictures. Others are answered as well, but cost this server more than they gain."""
    congestion_control: CongestionControl | None = None
    """Of WebTransport and HTTP/3; null if there is neither, and from older services."""
    tcp_congestion_control: str | None = None
    """Of HTTP/1.1, and so of DASH: the kernel's, such as `cubic`; null if it does not say."""
    why_no_training: str | None = None
    """One sentence: why scenes' networks cannot be trained here; null if they can."""


class HostLoad(WireModel):
    """A service's load and configuration, for the director of a cluster (`/api/load`)."""

    config: ServerConfig
    """Like `/config.json`, for the name under which the host was reached. `retry_after_s` is set if it is full."""
    viewers: int = Field(ge=0)
    utilisation: Unit
    """Utilisation of the busier part: the edges, taken together, or the renderer."""
    queue_age_s: float = Field(ge=0)
    """The longest that anything waited anywhere in the last second."""
    scenes: Entries[str]
    """Ids of loaded scenes."""
