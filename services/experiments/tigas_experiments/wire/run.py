"""Configuration of a run: everything needed to repeat it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self, get_args

from pydantic import AfterValidator, Field, model_validator

from tigas_common.wire.dash import RepresentationRequest
from tigas_common.wire.model import MAX_SIDE, Entries, WireModel
from tigas_common.wire.shaper import LinkSetting
from tigas_experiments.wire.movement import TimedPose

PerViewMode = Literal["stateless", "video"]
"""The page requests each view, as chosen by a controller, as one JPEG or as one frame of a video."""
DashMode = Literal["dash-typical", "dash-tuned", "dash-edge"]
"""DASH as in live services, with the lowest latency that dash.js sustains, or with that of a bare player."""
LocalMode = Literal["local-ply", "local-compressed", "local-streamed"]
"""The page renders the scene, downloaded as a plain PLY (only in earlier records), compressed, or streamed in levels of
detail."""
Mode = Literal[PerViewMode, DashMode, "webrtc", LocalMode]
PER_VIEW: tuple[Mode, ...] = get_args(PerViewMode)
DASH: tuple[Mode, ...] = get_args(DashMode)
LOCAL: tuple[Mode, ...] = get_args(LocalMode)
MODE_NAMES: dict[Mode, str] = {
    "stateless": "Stateless",
    "video": "Video",
    "dash-typical": "DASH, typical",
    "dash-tuned": "DASH, tuned",
    "dash-edge": "DASH, edge",
    "webrtc": "WebRTC",
    "local-ply": "Local, PLY",
    "local-compressed": "Local, compressed",
    "local-streamed": "Local, streamed",
}
MODES: tuple[Mode, ...] = tuple(mode for mode in MODE_NAMES if mode != "local-ply")
"""Modes available for new runs."""
DashTransport = Literal["tcp", "h3"]
DASH_TRANSPORTS: dict[DashTransport, str] = {"tcp": "TCP", "h3": "HTTP/3"}
"""How DASH segments are fetched, over HTTP/1.1 or over HTTP/3 from the render service; with display names."""
SOURCES = ("stateless", "video", "dash", "webrtc", "local")
"""Ways in which the page can show a scene; one file each in web/packages/viewer/sources."""
SIDE_MODES = (*PER_VIEW, *DASH, "dash-custom", "webrtc", "local")
"""Choices for a side of the page's comparison: a source, and for a stream its preset."""
USUAL_SIDES = ("stateless", "dash-tuned")
FrameRate = Literal[30, 60]
OFF: Literal["off"] = "off"
"""Used in place of a model's name."""
UNSHAPED = "unshaped"
USUAL_UP_KBPS = 10_000.0
"""Uplink of a constant link unless given."""


class LinkTerm(NamedTuple):
    """One term in the label of a constant link, such as `20mbit`."""

    field: str
    """Field of LinkSetting."""
    unit: str
    scale: float
    """Field value per unit."""
    usual: float | None
    """Field value for which the label omits the term."""


LINK_TERMS = (
    LinkTerm("down_kbps", "mbit", 1000.0, None),
    LinkTerm("up_kbps", "mbit-up", 1000.0, USUAL_UP_KBPS),
    LinkTerm("jitter_ms", "ms-jitter", 1.0, 0.0),
    LinkTerm("loss_pct", "%-loss", 1.0, 0.0),
    LinkTerm("delay_ms", "ms-rtt", 0.5, 0.0),
)
"""Terms of a label, in order; a round trip is twice the delay."""
MAX_RTT_MS = 120_000.0
MAX_OFFSET_S = 86_400.0


def _page_name(name: str) -> str:
    if not re.fullmatch("[a-z0-9][a-z0-9-]{0,23}", name):
        raise ValueError(f"{name!r} is not the name of a model or predictor")
    return name


PageName = Annotated[str, AfterValidator(_page_name)]
"""Name that the page gives to a model or predictor."""
ModelName = PageName
"""Name of one of the page's models, which only the page knows."""
PredictorName = Literal["off", "velocity", "linear"]
"""The page's pose predictors."""
Overscan = Literal["auto"] | Annotated[float, Field(ge=0, le=0.5)]
"""Additional margin of frames on each side, as a share of the viewport; `auto` lets the page decide."""
AUTO: Literal["auto"] = "auto"


class Network(WireModel):
    """The network of a run: a constant link, a trace (of the shaper or from a file), or unshaped."""

    link: LinkSetting | None = None
    """A constant link."""
    trace: str | None = Field(default=None, min_length=1, max_length=100)
    """Name of a trace: the shaper's own, or that of its file."""
    trace_file: Path | None = None
    """Path of the trace's file as given; None if the shaper knows the trace by name."""
    rtt_ms: float | None = Field(default=None, ge=0, le=MAX_RTT_MS)
    """Replaces a trace's own delay and jitter. A constant link defines its delay itself."""
    offset_s: float = Field(default=0.0, ge=0, le=MAX_OFFSET_S)
    """Position in the trace at which a run starts."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.link is not None and self.trace is not None:
            raise ValueError("a network is a constant link or a trace, not both")
        if self.trace is None and self.trace_file is not None:
            raise ValueError("a trace's file needs the trace's name")
        if self.trace is None and self.rtt_ms is not None:
            raise ValueError("only a trace's round trip can be replaced")
        if self.trace is None and self.offset_s:
            raise ValueError("only a trace can begin at another position")
        return self

    @property
    def shaped(self) -> bool:
        """Whether it needs a shaper."""
        return self.link is not None or self.trace is not None

    @property
    def round_trip_ms(self) -> float | None:
        """The added round trip, if it is constant and known before the run."""
        return self.rtt_ms if self.link is None else 2 * self.link.delay_ms

    @property
    def name(self) -> str:
        """The label without the round trip: `20mbit,0.1%-loss`, `4g-bus` or `unshaped`."""
        return _rates(self.link) if self.link is not None else self.trace or UNSHAPED

    @property
    def label(self) -> str:
        """The network as named in an experiment file: `20mbit,0.1%-loss,20ms-rtt` or `4g-bus,100ms-rtt`."""
        rtt = self.round_trip_ms
        return self.name if rtt is None or (rtt == 0 and self.trace is None) else f"{self.name},{rtt:g}ms-rtt"

    def with_rtt(self, rtt_ms: float) -> Network:
        """The same rates with another round trip. Raises ValueError."""
        if self.link is not None:
            return self.model_copy(update={"link": replace(self.link, delay_ms=rtt_ms / 2)})
        if self.trace is None:
            raise ValueError("the round trip of an unshaped network cannot be set")
        return self.model_copy(update={"rtt_ms": rtt_ms})


class Configuration(WireModel):
    """Configuration of one run. Runs with equal configurations get equal inputs."""

    scene: str
    movement: str
    """Name of a generated movement, or path of a movement trace as given."""
    movement_offset_s: float = Field(default=0.0, ge=0, le=MAX_OFFSET_S)
    """Time in the movement at which a run starts."""
    network: Network
    mode: Mode
    duration_s: float = Field(ge=1, le=7200)
    width: int = Field(ge=64, le=MAX_SIDE)
    height: int = Field(ge=64, le=MAX_SIDE)
    """Size of the viewport, in CSS pixels."""
    profile: int | str = "seen"
    """Modes `stateless` and `video`: rung of the ladder, or name of a controller."""
    dash_frame_rate: FrameRate | None = None
    """DASH modes: frames per second; None for the preset's own."""
    dash_representation: RepresentationRequest | None = None
    """DASH modes: the stream's only representation; None for all that the packager offers."""
    dash_transport: DashTransport = "tcp"
    restore: ModelName = OFF
    """Modes `stateless` and `video`: the model that restores frames in the page, or `off`."""
    upscale: ModelName = OFF
    """Model that enlarges them afterwards, or `off`."""
    reprojection: bool = False
    """Whether the page reprojects the newest frame to the pose of each animation frame."""
    prediction: PageName = OFF
    """Predictor of requested poses, or `off`; old runs may name a removed predictor."""
    overscan: Overscan = AUTO
    """Reprojection: additional margin on each side, or `auto`."""
    depth: bool = True
    """Reprojection: whether frames include a coarse depth map."""
    surround: bool = True
    """Reprojection in the modes `stateless` and `video`: whether small pictures in all directions are requested."""
    seed: int = Field(default=1, ge=0, le=2**53 - 1)
    """Seed of generated movements and of the controllers' random numbers."""
    segment: int = Field(default=0, ge=0)
    """Number of the segment, in an experiment that uses several parts of its traces and movements."""
    repeat: int = Field(default=0, ge=0)
    capture_every_ms: float = Field(default=1000.0, ge=0)
    """Interval at which the screen is captured; 0 for none."""
    sample_stride: int = Field(default=0, ge=0, le=100_000)
    """Mode `stateless`: sample every n-th shown frame, with its request; 0 for none."""
    warm_up_s: float = Field(default=5.0, ge=0, le=600)
    """Time for which the viewer stands at the first pose, with frames on screen, before the movement starts."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if isinstance(self.profile, int) and not 0 <= self.profile <= 255:
            raise ValueError("the profile is a rung of the ladder, counted from 0, or a controller's name")
        return self

    @property
    def streamed(self) -> bool:
        """Whether it plays a stream from the packager."""
        return self.mode == "webrtc" or self.mode.startswith("dash")

    @property
    def over_h3(self) -> bool:
        """Whether its segments are fetched over HTTP/3."""
        return self.mode in DASH and self.dash_transport == "h3"

    @property
    def local(self) -> bool:
        """Whether the page downloads the scene and renders it itself."""
        return self.mode in LOCAL

    @property
    def download_form(self) -> str:
        """The form of the scene that the mode downloads, as in SceneDownload."""
        return self.mode.removeprefix("local-")

    @property
    def enhanced(self) -> bool:
        """Whether the page enhances frames."""
        return (self.restore, self.upscale) != (OFF, OFF)

    @property
    def motion(self) -> tuple[str, ...]:
        """Motion compensation of the page: any of `reprojection`, `overscan-0.1`, `no-depth`, `no-surround` and
        `prediction-linear`."""
        words = ["reprojection"] if self.reprojection else []
        if self.reprojection and self.overscan != AUTO:
            words.append(f"overscan-{self.overscan:g}")
        if self.reprojection and not self.depth:
            words.append("no-depth")
        if self.reprojection and not self.surround:
            words.append("no-surround")
        return (*words, *((f"prediction-{self.prediction}",) if self.prediction != OFF else ()))

    def asks_for_the_same(self, other: Configuration) -> bool:
        """Whether the two are equal except for the folders of files."""
        return self._without_folders() == other._without_folders()

    def _without_folders(self) -> Configuration:
        network = self.network.model_copy(update={"trace_file": None})
        return self.model_copy(update={"movement": Path(self.movement).name, "network": network})

    @property
    def slug(self) -> str:
        """Name of the run's folder."""
        chosen = self.profile if self.mode in PER_VIEW else self.dash_representation
        transport = self.dash_transport if self.over_h3 else None
        mode = "-".join(str(part) for part in (self.mode, transport, chosen) if part is not None)
        name, label = self.network.name, self.network.label
        network = name[:30] + label.removeprefix(name)  # leaves room for the round trip after a long name
        models = (("restore", self.restore), ("upscale", self.upscale))
        enhanced = (f"{kind}-{name}" for kind, name in models if name != OFF)
        segment = (f"s{self.segment}",) if self.segment else ()
        shown = (*enhanced, *self.motion, *segment)
        parts = (self.scene, Path(self.movement).stem, network, mode, *shown, f"{self.repeat}")
        return "_".join(re.sub(r"[^A-Za-z0-9.-]+", "-", part).strip(".-")[:40] or "x" for part in parts)


class RunPlan(WireModel):
    """The part of a run that the page plays and records."""

    points: Entries[TimedPose]
    """The movement, ordered by time."""
    duration_ms: float
    capture_every_ms: float
    """Interval at which the screen is captured; 0 for none."""
    sample_stride: int
    """Mode `stateless`: sample every n-th shown frame; 0 for none."""
    download: bool
    """Whether the recording starts with the mode `local`, and so with the download of the scene."""


def _rates(link: LinkSetting) -> str:
    """All terms except the round trip, without usual values."""
    values = ((term, float(getattr(link, term.field))) for term in LINK_TERMS if term.field != "delay_ms")
    return ",".join(f"{value / term.scale:g}{term.unit}" for term, value in values if value != term.usual)
