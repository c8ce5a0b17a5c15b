"""The shaper's settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from pydantic_settings import SettingsConfigDict

from tigas_common.command import NO_FLAG, Metavar
from tigas_common.settings import Listen, Origins, ServiceSettings
from tigas_common.topology import PAGE_ORIGINS, SHAPER
from tigas_common.wire.shaper import MAX_RATE_KBPS


class ShaperSettings(ServiceSettings):
    """Settings of `tigas shaper`: its flags, the table [shaper] of `tigas.toml`, and TIGAS_SHAPER_<NAME>."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_SHAPER_")
    table: ClassVar[str] = "shaper"

    access: Annotated[str, Metavar("NAME|NETWORK")]
    """Interface towards the clients: its name, such as eth0, or an IPv4 network in which it has an address."""
    service: Annotated[str, Metavar("NAME|NETWORK")]
    """Interface towards the services, such as 172.30.2.0/24."""
    forward: Annotated[tuple[str, ...], Metavar("PROTOCOL:PORT=HOST:PORT")] = Field(min_length=1, max_length=64)
    """Port to forward, such as tcp:8080=render:8080."""
    traces: Path | None = None
    """Directory of network traces."""
    trace: Annotated[str | None, NO_FLAG] = None
    """Trace to play at start-up; without one, the link is constant."""
    http: Listen = SHAPER.loopback
    """Address of the API."""
    allow_origins: Annotated[Origins, NO_FLAG] = PAGE_ORIGINS
    """Origins of other hosts' pages that may use the service."""
    down_kbps: Annotated[float, NO_FLAG] = Field(default=100_000, gt=0, le=MAX_RATE_KBPS)
    """Rate towards the clients while no trace plays, in kbit/s."""
    up_kbps: Annotated[float, NO_FLAG] = Field(default=100_000, gt=0, le=MAX_RATE_KBPS)
    """Rate from the clients while no trace plays, in kbit/s."""
    queue_ms: Annotated[float, NO_FLAG] = Field(default=150.0, ge=1, le=10_000)
    """Length of each direction's queue: the time to drain it at the trace's mean rate, in ms."""
    backend: Annotated[Literal["auto", "netem", "relay"], NO_FLAG] = "auto"
    """Implementation of delay, jitter and loss; `auto` chooses netem if the kernel has it."""
