"""How much one client, and all clients together, may take of a service over HTTP/1.1."""

from __future__ import annotations

import math
from typing import Self

from pydantic import BaseModel, ConfigDict, Field


class HttpLimits(BaseModel):
    """A setting of every service: a table `http_limits` in its table of `tigas.toml`. Times are in seconds.

    The defaults let an upload through at 50 kbit/s, and some twenty viewers from behind one address.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    connections: int = Field(default=512, ge=1, le=100_000)
    """Connections at once; further ones are answered 503."""
    connections_per_address: int = Field(default=128, ge=1, le=100_000)
    """The same of one IPv4 address, or one /64 of IPv6."""
    header_s: float = Field(default=10.0, gt=0, le=86_400)
    """For a request's headers to be complete, and for TLS to begin and to end."""
    body_s: float = Field(default=30.0, gt=0, le=86_400)
    """For the next part of a request's body."""
    body_bytes_per_s: float = Field(default=500.0, gt=0, le=1e9)
    """The lasting rate below which a body is given up, although its parts come in time."""
    idle_s: int = Field(default=5, ge=1, le=86_400)
    """For the next request on a connection."""
    unread_s: float = Field(default=30.0, gt=0, le=86_400)
    """For a client that takes nothing of what is sent to it (on Linux)."""

    def of_each(self, processes: int) -> Self:
        """The limits of each of several processes, which count by themselves: rounded up where they do not divide."""
        counts = ("connections", "connections_per_address")
        return self.model_copy(update={name: math.ceil(getattr(self, name) / processes) for name in counts})
