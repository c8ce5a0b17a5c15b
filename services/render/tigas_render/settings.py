"""The render service's settings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag
from pydantic_settings import NoDecode, SettingsConfigDict

from tigas_common.address import Address, reached_by_others
from tigas_common.settings import MODELS, Listen, ListenOrOff, ServiceSettings
from tigas_common.topology import PAGE, PAGE_HTTPS, WEBTRANSPORT, ServiceName
from tigas_common.wire.render import DEFAULT_LADDER, LadderName, Rung
from tigas_render.cache import cache_directory
from tigas_render.encode.video_chains import VIDEO_ENCODERS
from tigas_render.scenes.ladder import MAX_RUNGS
from tigas_render.transport.limits import Limits

Ladder = Annotated[
    Annotated[LadderName, Tag("name")]
    | Annotated[tuple[Rung, ...], Field(min_length=1, max_length=MAX_RUNGS), Tag("rungs")],
    Discriminator(lambda given: "name" if isinstance(given, str) else "rungs"),
]


MAX_EDGES = 64


def _edges(value: Any) -> Any:
    if value in ("auto", None):
        return None
    if re.fullmatch("[0-9]{1,3}", str(value)) and 1 <= int(value) <= MAX_EDGES:
        return int(value)
    raise ValueError(f"{str(value)[:100]!r} is neither auto nor a number from 1 to {MAX_EDGES}")


def _named_urls(value: Any) -> Any:
    """From the command line they come as NAME=URL."""
    if not isinstance(value, list):
        return value
    if wrong := [each for each in value if "=" not in each]:
        raise ValueError(f"{wrong[0][:100]!r} is not NAME=URL, such as dash=http://127.0.0.1:8081")
    return dict(each.split("=", 1) for each in value)


Upstream = Annotated[str, Field(pattern=r"^http://(\[[0-9A-Fa-f:.]+\]|[0-9A-Za-z._-]+)(:[0-9]{1,5})?/?$")]
_DEVICE = "(cpu|cuda:[0-9]{1,3}|instant(:[0-9]{1,7}(:[1-9][0-9]{0,4})?)?)"
Edges = Annotated[int | None, NoDecode, BeforeValidator(_edges)]


class RenderSettings(ServiceSettings):
    """Each can be set in `tigas.toml` under [render], as TIGAS_RENDER_<NAME>, or as a flag of `tigas render`."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_RENDER_", extra="forbid", frozen=True)
    table: ClassVar[str] = "render"

    scenes: Path = MODELS
    """The models directory."""
    lan: bool = False
    """Whether other devices on the network are served, too, where the addresses below are left as they are."""
    http: Listen = Field(default_factory=lambda given: PAGE.everywhere if given["lan"] else PAGE.loopback)
    """Address of the page and the API over HTTP/1.1."""
    https: ListenOrOff = Field(default_factory=lambda given: PAGE_HTTPS.everywhere if given["lan"] else None)
    """Address of the same over HTTPS, for other devices on the network."""
    quic: ListenOrOff = Field(
        default_factory=lambda given: Address("::" if given["lan"] else "localhost", WEBTRANSPORT.number)
    )
    """Address of HTTP/3 and WebTransport; `localhost` is 127.0.0.1 and ::1; `off` disables both."""
    edges: Edges = None
    """How many processes speak with clients, beside one that renders; 1: one does all; None: what suits the machine."""
    device: str = Field(default="auto", pattern=rf"^(auto|cuda|{_DEVICE}(,{_DEVICE})*)$")
    """The devices to render on: `cpu`, `cuda` for all GPUs, `cuda:N` for one of them, several of these with commas
    between them, or `auto` for the fastest there are. `instant`, `instant:BYTES` and `instant:BYTES:FRAMES_PER_S`
    render nothing: frames are made up, to measure everything else."""
    congestion_control: Literal["reno", "cubic"] = "reno"
    """QUIC's congestion control."""
    quic_limits: Limits = Limits()
    """What clients may ask of HTTP/3 and WebTransport, each, by address, and together."""
    waiting_per_address: int = Field(default=128, ge=1)
    """Requests of one address that may wait for the renderer; further ones are refused."""
    video_encoders: int = Field(default=VIDEO_ENCODERS, ge=1, le=4096)
    """Viewers whose videos each device encodes at a time; more than 1280×720 pixels count as several. Beyond, of the
    address that has the most, whoever has not asked for the longest begins anew."""
    memory_gb: float = Field(default=8.0, gt=0, le=100_000)
    """Memory limit for loaded scenes on each device, in gigabytes (10⁹ bytes)."""
    idle_minutes: float = Field(default=15.0, gt=0, le=525_600)
    """Scenes unused for this many minutes are unloaded."""
    ladder: Ladder = "scene"
    """Quality levels: each scene's own, or else the paper's; the paper's; or these, the best first."""
    cache: Path = Field(default_factory=cache_directory)
    """The cache directory of rendered previews, and of what scenes are downloaded as."""
    downloads_gb: float = Field(default=8.0, ge=0, le=100_000)
    """What files of scenes for download may take in the cache directory, in gigabytes; 0: none are offered."""
    edit_scenes: bool | None = None
    """Whether pages may add, rename and delete scenes; None: if nobody but this machine reaches the service."""
    services: dict[str, str] = Field(default_factory=dict)
    """Base URLs of other services for the page, by name; a bare `:PORT` means the page's own host."""
    upstreams: Annotated[dict[ServiceName, Upstream], BeforeValidator(_named_urls)] = Field(default_factory=dict)
    """Base URLs by which this service reaches others, by name: it hands on what is asked below `/services/NAME/`. Pages
    use that where they do not reach the service directly, and where `services` does not name it."""

    @property
    def default_ladder(self) -> tuple[Rung, ...]:
        """Of scenes that are not shown with one of their own."""
        return DEFAULT_LADDER if isinstance(self.ladder, str) else self.ladder

    @property
    def addresses(self) -> list[Address]:
        """All that the service listens on."""
        return [address for address in (self.http, self.https, self.quic) if address]

    @property
    def pages_edit_scenes(self) -> bool:
        """What `edit_scenes` comes to. Another name or page that is allowed tells of a proxy in front."""
        if self.edit_scenes is not None:
            return self.edit_scenes
        return not (reached_by_others(self.addresses) or self.allow_hosts or self.allow_origins)
