"""What travels between a client and the render service."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Literal, Self

from pydantic import Field, model_validator

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.model import MAX_PIXELS, MAX_SIDE, Angle, Entries, Point, Quaternion, Unit, WireModel

FrameFormat = Literal["jpeg", "png", "yuv420p"]
"""What every rasteriser encodes."""
AnswerFormat = Literal[FrameFormat, "h264", "webp"]
"""Of a picture by itself, or, of `h264`, one that may refer to the one before it."""
StillFormat = Literal["jpeg", "webp"]
"""Of what a viewer sees in the stateless mode."""
DownloadForm = Literal["ply", "compressed"]
LadderName = Literal["scene", "paper"]
"""What profiles count in: each scene's own ladder, where it has one, or the paper's for all."""


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
    """How a view is to be encoded as the next frame of its session's video."""

    bitrate_kbps: int = Field(ge=10, le=200_000)
    frames_per_s: float = Field(default=60, ge=1, le=240)
    """How many frames share the bit rate: each gets its part, key frames too."""
    key: bool = False
    """The client can use no frame that refers to earlier ones: the answer is to be a key frame."""


class RenderRequest(WireModel):
    """One view to render. The pose is either Euler angles and `translation`, or `position` and `quaternion`."""

    scene: str = Field(max_length=256)
    seq: int = Field(default=0, ge=0, lt=2**32)
    """The client's own number for this request; the answer carries it."""

    azimuth: Angle | None = None
    """Degrees, positive to the right."""
    elevation: Angle | None = None
    """Degrees, positive upwards."""
    roll: Angle | None = None
    """Degrees, positive clockwise."""
    translation: Point | None = None
    """The camera's centre, in scene units."""
    position: Point | None = None
    """The camera's centre, in scene units."""
    quaternion: Quaternion | None = None
    """Camera to world, [x, y, z, w]."""

    fx: float = Field(gt=0, le=1e6)
    fy: float = Field(gt=0, le=1e6)
    cx: float = Field(ge=-1e6, le=1e6)
    cy: float = Field(ge=-1e6, le=1e6)
    width: int = Field(ge=1, le=MAX_SIDE)
    height: int = Field(ge=1, le=MAX_SIDE)
    """fx, fy, cx, cy are in pixels for this viewport."""

    profile: int | None = Field(default=None, ge=0, le=255)
    """The rung of the scene's ladder; left out: the viewport's own resolution, and the best rung's quality."""
    display_scale: float = Field(default=1, ge=1, le=64)
    """How many times larger than the viewport the frame is shown, linearly."""
    overscan: float = Field(default=0, ge=0, le=MAX_OVERSCAN)
    """How much more the frame shows at each side, as a share of the viewport's width (left, right) and height (top,
    bottom), at the same pixels per angle."""
    depth: bool = False
    """Whether a JPEG or WebP is to carry a coarse depth of the view; other formats never do."""
    format: AnswerFormat = "jpeg"
    video: VideoRequest | None = None
    """Needed for the format `h264`, and allowed for no other."""
    deadline_ms: float | None = Field(default=None, gt=0, le=60_000)
    """How long after its arrival the frame is still of use, in milliseconds."""
    stamp: int | None = Field(default=None, ge=0, lt=2**24)
    """A number to draw into the frame, for tests that read from a screen which request it shows."""

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
    def at(
        cls,
        scene: str,
        pose: Pose,
        intrinsics: Intrinsics,
        *,
        profile: int | None = None,
        display_scale: float = 1,
        overscan: float = 0,
        depth: bool = False,
        format: AnswerFormat = "jpeg",
        video: VideoRequest | None = None,
        stamp: int | None = None,
    ) -> Self:
        """The view of a scene from a pose."""
        return cls(
            scene=scene,
            position=pose.position,
            quaternion=pose.quaternion,
            **asdict(intrinsics),
            profile=profile,
            display_scale=display_scale,
            overscan=overscan,
            depth=depth,
            format=format,
            video=video,
            stamp=stamp,
        )

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
    """Whether it can be decoded by itself."""
    after: int | None
    """The `seq` of the frame that it refers to, the last one of the video; null for a key frame."""
    codec: str
    """Such as `avc1.4d401f` (RFC 6381), for WebCodecs."""


class FrameHeader(WireModel):
    """Goes before the body on WebTransport. From status 400 on, the body is a Problem and the rest is null."""

    status: int
    seq: int
    content_type: str
    width: int | None = None
    height: int | None = None
    margin_x: int | None = None
    """Of the frame's columns, how many lie beyond the viewport at the left and as many at the right; null for none."""
    margin_y: int | None = None
    """The same of its rows, at the top and at the bottom."""
    profile: int | None = None
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


class SceneDownload(WireModel):
    """A file of the scene's Gaussians, at `/scenes/{id}/download/{form}`; it is made when somebody first asks for it.

    Its rows are ordered so that whoever has only the first of them has the best picture of so many.
    """

    form: DownloadForm
    bytes: int | None = None
    """Its length; null until it was made, as are the others."""
    sha256: str | None = None
    """In hexadecimal digits; also its ETag."""
    gaussians: int | None = None


class SceneInfo(WireModel):
    """What is known of a scene without loading it; `camera` is known once it was loaded, or from its scene.json."""

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
    """In hexadecimal digits; null until the file was loaded once, and without a file."""
    format: str | None = Field(default=None, max_length=100)
    """Of the file, for people: `PLY`, `SPZ 4`; null if it cannot be read, and without a file."""
    antialiased: bool = False
    """Whether its Gaussians are to be drawn with Mip-Splatting's 2D filter, as far as the file says."""
    memory_bytes: int
    """What it takes in memory now; 0 unless loaded."""
    preview: str
    """The preview's URL, relative to the server's root."""
    up: Point
    camera: StartCamera | None
    background: tuple[Unit, Unit, Unit]
    """RGB, 0 to 1."""
    enhance: Literal["scene", "general"] | None = None
    """Whose networks can enhance its frames: its own, trained on this very file, or those for any scene."""
    ladder: Entries[Rung] | None = None
    """What profiles count in where the scene has a ladder of its own; null: in the server's."""
    builtin: bool = False
    """Whether it is part of the service, which can neither rename nor delete it."""
    downloads: Entries[SceneDownload] = ()
    """As what it can be downloaded, to be rendered elsewhere; none if it is broken or the server offers none."""


class SceneName(WireModel):
    """What a scene is to be called from now on."""

    name: str = Field(max_length=200)


class AddedScene(WireModel):
    """What an upload has become."""

    id: str


class Training(WireModel):
    """How far the training of a scene's networks is."""

    state: Literal["idle", "running", "done", "failed"]
    progress: Unit = 0
    stage: str = ""
    """What it is doing."""
    problem: str | None = None
    """One sentence: why it failed, or why the networks that the scene has cannot be used."""


class ServerConfig(WireModel):
    """What the page needs to know of its server (`/config.json`)."""

    version: str
    commit: str | None = None
    """Of its code, with `-dirty` if that was changed; null if it is unknown."""
    device: str | None = None
    """What it renders with: `cpu`, or the graphics processor's name."""
    ladder: Entries[Rung]
    """Of the scenes that have none of their own."""
    certificate_sha256: str | None
    """Base64 of the SHA-256 of the certificate's DER, for `serverCertificateHashes`."""
    webtransport_url: str | None
    """Where to open the WebTransport session, fitted to the address that the page was opened under."""
    https_url: str | None
    """The same page as a secure context, for other devices on the network."""
    services: dict[str, str]
    """Other services by name, such as `dash`, with their base URLs."""
    retry_after_s: float | None = None
    """The server is full: after so many seconds a new viewer may try again. Null if it takes new viewers."""
    host: str | None = None
    """In a cluster, the name of the host that serves the scene which was asked about; null: there is only this one."""
    render_url: str | None = None
    """Base URL for `POST /render`; null: the page's own origin."""
    max_upload_bytes: int | None = None
    """The largest file that a page may add as a scene; null: it may add, rename and delete none."""
    has_scene: bool | None = None
    """Whether there is the scene that was asked about; null if none was, and in a cluster."""
    formats: Entries[StillFormat] = ("jpeg",)
    """What to ask for pictures as. Others are answered, too, but cost this server more than they are worth."""
    why_no_training: str | None = None
    """One sentence: why scenes' networks cannot be trained here; null if they can."""
