"""The settings of `tigas cluster`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field
from pydantic_settings import NoDecode, SettingsConfigDict

from tigas_cluster.scaling import HostRange
from tigas_common.settings import Listen, ServiceSettings
from tigas_common.topology import PAGE


def _range(value: Any) -> Any:
    return value if isinstance(value, HostRange) else HostRange.parse(str(value))


Hosts = Annotated[HostRange, NoDecode, BeforeValidator(_range)]
"""A setting that is a number of hosts, written N or MIN..MAX."""
PortNumber = Annotated[int, Field(ge=0, le=65535)]


class ClusterSettings(ServiceSettings):
    """Each can be set in `tigas.toml` under [cluster], as TIGAS_CLUSTER_<NAME>, or as a flag of `tigas cluster up`."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_CLUSTER_", extra="forbid", frozen=True)
    table: ClassVar[str] = "cluster"

    http: Listen = PAGE.loopback
    """Address of the page and the API."""
    hosts: Hosts = HostRange(1, 64)
    """How many hosts there may be."""
    scenes: Path | None = None
    """The models directory, at the same place on every machine."""
    resource: str | None = None
    """What a machine has, in Ray's words, that may be a host; a host takes all of it. None: `GPU`, or in a Ray of our
    own what its only node has."""
    host_http_port: PortNumber = 0
    """Port of each host's API; 0: any free one."""
    host_quic_port: PortNumber = 0
    """Port of each host's HTTP/3 and WebTransport; 0: any free one."""
    calm_minutes: float = Field(default=5.0, gt=0, le=1440)
    """Fewer hosts must have been enough for so many minutes before one drains."""
    grace_minutes: float = Field(default=10.0, gt=0, le=1440)
    """A host that drains ends after so many minutes, even if viewers are left."""
    services: dict[str, str] = Field(default_factory=dict)
    """Base URLs of other services for the page, by name; a bare `:PORT` means the page's own host."""
