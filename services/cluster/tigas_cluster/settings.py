"""The settings of `tigas cluster`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field
from pydantic_settings import NoDecode, SettingsConfigDict

from tigas_common.command import NO_FLAG, Metavar
from tigas_common.settings import Listen, ServiceSettings
from tigas_common.topology import PAGE


@dataclass(frozen=True, slots=True)
class HostRange:
    lowest: int
    highest: int

    def __str__(self) -> str:
        return f"{self.lowest}..{self.highest}"

    @classmethod
    def parse(cls, text: str) -> HostRange:
        """Read `N` or `MIN..MAX`. Raises ValueError with one sentence."""
        found = re.fullmatch(r"([0-9]{1,4})(?:\.\.([0-9]{1,4}))?", text)
        lowest, highest = (int(found[1]), int(found[2] or found[1])) if found else (0, 0)
        if not 1 <= lowest <= highest:
            raise ValueError(f"{text[:100]!r} is neither a number of hosts nor MIN..MAX, such as 2 or 1..8")
        return cls(lowest, highest)

    def clamp(self, number: int) -> int:
        return min(max(number, self.lowest), self.highest)


def _range(value: Any) -> Any:
    return value if isinstance(value, HostRange) else HostRange.parse(str(value))


Hosts = Annotated[HostRange, NoDecode, BeforeValidator(_range), Metavar("N|MIN..MAX")]
"""A setting for a number of hosts, written N or MIN..MAX."""
PortNumber = Annotated[int, Field(ge=0, le=65535)]


class ClusterSettings(ServiceSettings):
    """Settings of `tigas cluster up`: its flags, the table [cluster] of `tigas.toml`, and TIGAS_CLUSTER_<NAME>."""

    model_config = SettingsConfigDict(env_prefix="TIGAS_CLUSTER_")
    table: ClassVar[str] = "cluster"

    http: Listen = PAGE.loopback
    """Address of the page and the API."""
    hosts: Hosts = HostRange(1, 64)
    """Number of hosts."""
    scenes: Annotated[Path | None, NO_FLAG] = None
    """Models directory, at the same path on every machine."""
    resource: Annotated[str | None, NO_FLAG] = None
    """Ray resource of the machines that may be hosts; a host takes all of it. By default GPU."""
    host_http_port: Annotated[PortNumber, NO_FLAG] = 0
    """Port of each host's API; 0 for any free one."""
    host_quic_port: Annotated[PortNumber, NO_FLAG] = 0
    """Port of each host's HTTP/3 and WebTransport; 0 for any free one."""
    calm_minutes: Annotated[float, NO_FLAG] = Field(default=5.0, gt=0, le=1440)
    """Minutes for which fewer hosts must have sufficed before one drains."""
    grace_minutes: Annotated[float, NO_FLAG] = Field(default=10.0, gt=0, le=1440)
    """Minutes after which a draining host ends, even if viewers remain."""
    services: Annotated[dict[str, str], NO_FLAG] = Field(default_factory=dict)
    """Base URLs of other services for the page, by name; a bare `:PORT` means the page's own host."""
