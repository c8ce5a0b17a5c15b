"""Limits on the requests of one client, of one address, and of all clients together."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, ConfigDict, Field

from tigas_common.limits import share_limit


class QuicLimits(BaseModel):
    """The render service's setting `quic_limits`, a subtable of its table in `tigas.toml`.

    The defaults suit a few hundred viewers, with a few dozen behind one address (an IPv4 address, or a /64 of IPv6).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    connections: int = Field(default=512, ge=1)
    """Concurrent connections; further ones are refused until others end."""
    connections_per_address: int = Field(default=64, ge=1)
    """Concurrent connections from one address."""
    handshakes_per_s: float = Field(default=8.0, gt=0)
    """Sustained rate of new connections from one address per second, with bursts of up to `connections_per_address`."""
    requests_per_address: int = Field(default=512, ge=1)
    """Running requests from one address; further ones are answered 503."""
    requests_per_s: float = Field(default=240.0, gt=0)
    """Sustained rate of one session's requests per second; further ones are answered 429. A busy server allows fewer,
    and announces the rate in its answers.
    """
    sessions_per_address: int = Field(default=64, ge=1)
    """WebTransport sessions from one address; further ones are answered 429."""


class Limits(QuicLimits):
    """All limits of a server. The limits below are not settings; they suit frames of up to a few megabytes.

    Times are in seconds.
    """

    unvalidated: int = 64
    """Unfinished handshakes before new clients must prove their address with a Retry (RFC 9000, 8.1)."""
    unvalidated_per_address: int = 8
    """Unfinished handshakes of one address before its new clients must do so."""
    requests: int = 64
    """Running and incomplete requests per connection, HTTP and WebTransport together; further ones are answered 503, or
    reset if incomplete.
    """
    resets_per_s: float = 480.0
    """Sustained rate per second at which one address may replace streams that were reset before they were answered,
    with bursts of a second's worth."""
    sessions: int = 4
    """WebTransport sessions per connection; further ones are answered 429."""
    stream_window: int = 64 * 1024
    """Bytes that a client may send on one stream ahead of the data read so far (QUIC flow control)."""
    unsent: int = 256 * 1024
    """Bytes of a connection's answers that may wait in QUIC for the network; the rest waits in the writer."""
    unread_answers: int = 2 * 1024 * 1024
    """Bytes of a connection's answers that may wait in QUIC for the network or for a client that does not read."""
    waiting_per_address: int = 256 * 1024 * 1024
    """Bytes of an address's answers that may wait in writers; streams with further answers are reset."""
    handshake_timeout: float = 5.0
    """Time for a client to complete the handshake."""
    request_timeout: float = 10.0
    """Time for a request's headers, the next part of its body, or a whole WebTransport request to arrive."""
    stall_timeout: float = 30.0
    """Time without reading after which a client's stream is reset."""
    idle_timeout: float = 30.0
    """Silence after which a client's connection is closed."""
    grace: float = 0.5
    """Time for running requests to finish once the server stops."""

    @classmethod
    def of(cls, settings: QuicLimits) -> Self:
        """The limits with these settings."""
        return cls(**settings.model_dump())

    def of_each(self, edges: int) -> Self:
        """The limits of each of several edges, which count independently of each other."""
        counts = (
            "connections", "connections_per_address", "unvalidated", "unvalidated_per_address", "requests_per_address",
            "sessions_per_address", "waiting_per_address",
        )  # fmt: skip
        parts: dict[str, float] = {name: share_limit(getattr(self, name), edges) for name in counts}
        rates = {name: getattr(self, name) / edges for name in ("handshakes_per_s", "resets_per_s")}
        return self.model_copy(update=parts | rates)
