"""The hosts and their state, as known to the director."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

from tigas_common.address import bracketed
from tigas_common.wire.render import HostLoad

PRESSED_UTILISATION, PRESSED_AGE_S = 0.8, 0.06
"""A host that is busier than this, or in which something waits for longer (in seconds), has no room to speak of."""


@dataclass(frozen=True, slots=True)
class HostAddress:
    """Where a host is."""

    name: str
    """As pages show it; unlike any other's."""
    api_url: str
    """Its API over plain HTTP for the director, such as `http://10.0.0.5:8080`."""
    public_host: str | None = None
    """The name or address under which pages reach it, if that is not the one in `api_url`; its ports are the same."""
    draining: bool = False
    """It is about to end: it gets no new viewers, and its viewers move elsewhere."""

    @property
    def public(self) -> str:
        """HOST:PORT of its API, as pages write it."""
        url = urlsplit(self.api_url)
        host = bracketed(self.public_host or url.hostname or "localhost")
        return f"{host}:{url.port}" if url.port else host


@dataclass(frozen=True, slots=True)
class HostState:
    """State of a host that is up."""

    address: HostAddress
    load: HostLoad
    """Its last report."""

    @property
    def name(self) -> str:
        return self.address.name

    @property
    def api_url(self) -> str:
        return self.address.api_url

    @property
    def draining(self) -> bool:
        return self.address.draining

    @property
    def webtransport_url(self) -> str | None:
        """Where a page opens its session."""
        return self.load.config.webtransport_url

    @property
    def certificate_sha256(self) -> str | None:
        """Digest of the certificate for the page to trust."""
        return self.load.config.certificate_sha256

    @property
    def render_url(self) -> str:
        """Base URL for a page's `POST /render`."""
        return f"http://{self.address.public}"

    @property
    def viewers(self) -> int:
        return self.load.viewers

    @property
    def full(self) -> float | None:
        """Seconds after which a new viewer may try again; None if it is admitted."""
        return self.load.config.retry_after_s

    @property
    def queue_age_s(self) -> float:
        return self.load.queue_age_s

    @property
    def pressed(self) -> bool:
        """Whether its scenes could do with another host."""
        busy = self.load.utilisation > PRESSED_UTILISATION or self.queue_age_s > PRESSED_AGE_S
        return busy or self.full is not None


class Fleet(ABC):
    """A changing set of hosts: this machine alone, a list, or a Ray cluster."""

    @abstractmethod
    def hosts(self) -> Sequence[HostState]:
        """Hosts that are up, with their last reports."""

    @abstractmethod
    async def suspect(self, name: str) -> None:
        """Check this host now, because a viewer reports it as silent. `hosts` reflects the outcome on return."""
