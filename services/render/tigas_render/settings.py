"""The render service's settings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_settings import NoDecode, SettingsConfigDict

from tigas_common.address import Address, reachable_addresses
from tigas_common.command import NO_FLAG, Metavar
from tigas_common.settings import MODELS, HostNames, Listen, ListenOrOff, Origins, ServiceSettings
from tigas_common.topology import PAGE, PAGE_HTTPS, WEBTRANSPORT, ServiceName
from tigas_common.wire.render import CongestionControl, LadderName
from tigas_render.admission.limits import QuicLimits
from tigas_render.local_files import cache_directory

MAX_EDGES = 64


def _edges(value: Any) -> Any:
    if value in ("auto", None):
        return None
    if re.fullmatch("[0-9]{1,3}", str(value)) and 1 <= int(value) <= MAX_EDGES:
        return int(value)
    raise ValueError(f"{str(value)[:100]!r} is neither auto nor a number from 1 to {MAX_EDGES}")


def _upstream(value: str) -> str:
    if not re.fullmatch(r"http://(\[[0-9A-Fa-f:.]+\]|[0-9A-Za-z._-]+)(:[0-9]{1,5})?/?", value):
        raise ValueError(f"{value[:100]!r} is not a service's URL, such as http://127.0.0.1:8081")
    return value


Upstream = Annotated[str, AfterValidator(_upstream)]
# `instant`, for tests and benchmarks, is undocumented (raster/instant.py).
_DEVICE = "(cpu|cuda:[0-9]{1,3}|instant(:[0-9]{1,7}(:[1-9][0-9]{0,4})?)?)"
Edges = Annotated[int | None, NoDecode, BeforeValidator(_edges), Metavar("auto|N")]


def _devices(value: str) -> str:
    if not re.fullmatch(rf"auto|cuda|{_DEVICE}(,{_DEVICE})*", value):
        raise ValueError(f"{value[:100]!r} is not auto, cpu, cuda, cuda:N, or several devices separated by commas")
    return value


Devices = Annotated[str, AfterValidator(_devices), Metavar("auto|cpu|cuda[:N],…")]


class RenderSettings(ServiceSettings):
    """Settings of `tigas render`: its flags, the table [render] of `tigas.toml`, and TIGAS_RENDER_<NAME>."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_RENDER_")
    table: ClassVar[str] = "render"

    allow_hosts: HostNames = ()
    """Host name that the service answers to, in addition to addresses and names of the local network."""
    allow_origins: Origins = ()
    """Origin of another host's pages that may use the service and embed it."""
    scenes: Path = MODELS
    """Models directory: a folder or a file for each scene."""
    lan: bool = False
    """Serve other devices on the network as well, over HTTPS too."""
    http: Listen = Field(default_factory=lambda given: PAGE.all_interfaces if given["lan"] else PAGE.loopback)
    """Address of the page and the API over HTTP/1.1."""
    https: ListenOrOff = Field(default_factory=lambda given: PAGE_HTTPS.all_interfaces if given["lan"] else None)
    """Address of the page and the API over HTTPS, for phones and other devices; or `off`."""
    quic: ListenOrOff = Field(
        default_factory=lambda given: Address("::" if given["lan"] else "localhost", WEBTRANSPORT.number)
    )
    """Address of HTTP/3 and WebTransport; `localhost` is 127.0.0.1 and ::1; `off` disables both."""
    edges: Edges = None
    """Number of processes that serve viewers; with 1 and a single device, one process does everything."""
    device: Devices = "auto"
    """Devices to render on, separated by commas; `cuda` is all GPUs, `auto` the fastest devices."""
    quic_limits: QuicLimits = QuicLimits()
    """Limits on HTTP/3 and WebTransport, in total and per address."""
    congestion_control: Annotated[CongestionControl, NO_FLAG] = "westwood"
    """Congestion control of HTTP/3: `westwood` tolerates random loss, `reno` is the paper's."""
    memory_gb: float = Field(default=8.0, gt=0, le=100_000)
    """Memory limit for loaded scenes on each device, in gigabytes (10⁹ bytes); frames need more."""
    idle_minutes: Annotated[float, NO_FLAG] = Field(default=15.0, gt=0, le=525_600)
    """Scenes unused for this many minutes are unloaded."""
    ladder: LadderName = "scene"
    """Quality levels: each scene's own, or the paper's."""
    cache: Annotated[Path, NO_FLAG] = Field(default_factory=cache_directory)
    """Cache directory of rendered previews and of scene files for download."""
    downloads_gb: Annotated[float, NO_FLAG] = Field(default=8.0, ge=0, le=100_000)
    """Disk space for scene files for download, in gigabytes; 0 disables downloads."""
    edit_scenes: bool | None = None
    """Let pages change scenes and train their networks; by default only if the service is limited to this machine."""
    services: Annotated[dict[str, str], NO_FLAG] = Field(default_factory=dict)
    """Base URLs of other services for the page, by name; a bare `:PORT` means the page's own host."""
    upstreams: Annotated[dict[ServiceName, Upstream], NO_FLAG] = Field(default_factory=dict)
    """URLs of services (dash, store, shaper) to proxy under `/services/NAME/`, for pages that cannot reach them."""

    @property
    def addresses(self) -> list[Address]:
        """All addresses on which the service listens."""
        return [address for address in (self.http, self.https, self.quic) if address]

    @property
    def pages_edit_scenes(self) -> bool:
        """The effective value of `edit_scenes`. Additional allowed hosts or origins suggest a proxy in front."""
        if self.edit_scenes is not None:
            return self.edit_scenes
        return not (reachable_addresses(self.addresses) or self.allow_hosts or self.allow_origins)
