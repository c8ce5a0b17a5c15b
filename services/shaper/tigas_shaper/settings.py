"""The shaper's settings."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field
from pydantic_settings import SettingsConfigDict

from tigas_common.settings import Listen, Origins, ServiceSettings
from tigas_common.topology import PAGE_ORIGINS, SHAPER
from tigas_common.wire.shaper import MAX_RATE_KBPS


class ShaperSettings(ServiceSettings):
    """Each can be set in `tigas.toml` under [shaper], as TIGAS_SHAPER_<NAME>, or as a flag of `tigas shaper`."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_SHAPER_", extra="forbid", frozen=True)
    table: ClassVar[str] = "shaper"

    access: str
    """The interface towards the clients: its name, or an IPv4 network in which it has an address."""
    service: str
    """The interface towards the services, likewise."""
    forward: tuple[str, ...] = Field(min_length=1, max_length=64)
    """What to forward: `tcp:PORT=HOST:PORT` and `udp:PORT=HOST:PORT`."""
    traces: Path | None = None
    """A directory of network traces."""
    trace: str | None = None
    """The trace to play at start-up; without one, the link is constant."""
    http: Listen = SHAPER.loopback
    """Address of the API."""
    allow_origins: Origins = PAGE_ORIGINS
    """As every service's; by default the page on this machine, wherever the shaper is."""
    down_kbps: float = Field(default=100_000, gt=0, le=MAX_RATE_KBPS)
    """The rate towards the clients while no trace plays, kbit/s."""
    up_kbps: float = Field(default=100_000, gt=0, le=MAX_RATE_KBPS)
    """The rate from the clients, likewise."""
    queue_ms: float = Field(default=150.0, ge=1, le=10_000)
    """The length of each direction's queue, as the time to drain it at the current trace's mean rate."""
    backend: Literal["auto", "netem", "relay"] = "auto"
    """What applies delay, jitter and loss; `auto` chooses netem if the kernel has it."""
