"""How much one client, one address, and all clients together may ask of the server."""

from __future__ import annotations

import math
from typing import Self

from pydantic import BaseModel, ConfigDict, Field


class Limits(BaseModel):
    """The render service's setting `quic_limits`: a table in its table of `tigas.toml`. Times are in seconds.

    The defaults suit frames of up to some megabytes and a few hundred viewers, some dozens of them behind one address
    (an IPv4 address, or a /64 of IPv6).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    connections: int = Field(default=512, ge=1)
    """Connections at once; further ones are refused until others end."""
    connections_per_address: int = Field(default=64, ge=1)
    """The same, of one address."""
    handshakes_per_s: float = Field(default=8.0, gt=0)
    """New connections of one address a second, in the long run; `connections_per_address` of them may come at once."""
    unvalidated: int = Field(default=64, ge=0)
    """Handshakes under way before new clients must prove their address with a Retry (RFC 9000, 8.1)."""
    unvalidated_per_address: int = Field(default=8, ge=0)
    """The same, of one address."""
    requests: int = Field(default=64, ge=1)
    """Running requests per connection, HTTP and WebTransport together, with those that have not arrived whole; further
    ones are answered 503, or reset if they have not arrived whole."""
    requests_per_address: int = Field(default=512, ge=1)
    """The same, of one address."""
    requests_per_s: float = Field(default=240.0, gt=0)
    """Requests of one session a second in the long run; further ones are answered 429. A busy server allows fewer, and
    says so in its answers."""
    sessions: int = Field(default=4, ge=1)
    """WebTransport sessions per connection; further ones are answered 429."""
    sessions_per_address: int = Field(default=64, ge=1)
    """The same, of one address."""
    unread: int = Field(default=256 * 1024, ge=1)
    """Bytes of one request body that wait for the application; a client that sends more is cut."""
    stream_window: int = Field(default=64 * 1024, ge=1024)
    """Bytes that a client may send on one stream ahead of what has arrived in order (QUIC flow control)."""
    unsent: int = Field(default=256 * 1024, ge=1)
    """Bytes of a connection's answers that wait in QUIC for the network; more waits with whoever writes it."""
    unread_answers: int = Field(default=2 * 1024 * 1024, ge=1)
    """The same, with those that wait for a client that does not read them."""
    handshake_timeout: float = Field(default=5.0, gt=0)
    """For a client to complete the handshake."""
    request_timeout: float = Field(default=10.0, gt=0)
    """For a request's headers, for the next part of its body, or for a whole WebTransport request to arrive."""
    stall_timeout: float = Field(default=30.0, gt=0)
    """For a client that reads nothing, before its stream is cut."""
    idle_timeout: float = Field(default=30.0, gt=0)
    """For a client that says nothing at all, before its connection ends."""
    grace: float = Field(default=0.5, ge=0)
    """For running requests to finish once the server stops."""

    def of_each(self, edges: int) -> Self:
        """The limits of each of several edges, which count by themselves: rounded up where they do not divide."""
        counts = (
            "connections", "connections_per_address", "unvalidated", "unvalidated_per_address", "requests_per_address",
            "sessions_per_address",
        )  # fmt: skip
        parts: dict[str, float] = {name: math.ceil(getattr(self, name) / edges) for name in counts}
        return self.model_copy(update=parts | {"handshakes_per_s": self.handshakes_per_s / edges})
