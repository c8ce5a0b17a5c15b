"""Limits on one client's, and on all clients' use of a service over HTTP/1.1."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, ConfigDict, Field

from tigas_common.quota import quota


class ServiceHttpLimits(BaseModel):
    """The setting `http_limits` of every service, a table in its table of `tigas.toml`.

    The defaults suit some twenty viewers behind one address.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    connections: int = Field(default=512, ge=1, le=100_000)
    """Connections at once; further ones are answered 503."""
    connections_per_address: int = Field(default=128, ge=1, le=100_000)
    """The same of one IPv4 address, or one /64 of IPv6."""
    loop_share_per_address: float = Field(default=0.2, gt=0, le=1)
    """The share of the event loop's time that one address may use in the long run, frames aside."""


class HttpLimits(ServiceHttpLimits):
    """All limits of a server. Those below are no settings; they let an upload through at 50 kbit/s.

    Times are in seconds.
    """

    header_s: float = 10.0
    """For a request's headers to be complete, and for TLS to begin and to end."""
    body_s: float = 30.0
    """For the next part of a request's body."""
    body_bytes_per_s: float = 500.0
    """Lasting rate below which a body is given up although its parts arrive in time."""
    idle_s: int = 5
    """For the next request on a connection."""
    unread_s: float = 30.0
    """For a client that does not read its responses (on Linux)."""

    @classmethod
    def of(cls, settings: ServiceHttpLimits) -> Self:
        """The limits with these settings."""
        return cls(**settings.model_dump())

    def of_each(self, processes: int) -> Self:
        """The limits of each of several processes, which count by themselves."""
        counts = ("connections", "connections_per_address")
        return self.model_copy(update={name: quota(getattr(self, name), processes) for name in counts})
