"""Limits on the requests of one client, of one address, and of all clients together."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, ConfigDict, Field

from tigas_common.limits import quota


class QuicLimits(BaseModel):
    """The render service's setting `quic_limits`, a table in its table of `tigas.toml`.

    The defaults suit a few hundred viewers, some dozens of them behind one address (an IPv4 address, or a /64 of IPv6).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    connections: int = Field(default=512, ge=1)
    """Connections at once; further ones are refused until others end."""
    connections_per_address: int = Field(default=64, ge=1)
    """The same, of one address."""
    handshakes_per_s: float = Field(default=8.0, gt=0)
    """New connections of one address a second, in the long run; `connections_per_address` of them may come at once."""
    requests_per_address: int = Field(default=512, ge=1)
    """Running requests of one address; further ones are answered 503."""
    requests_per_s: float = Field(default=240.0, gt=0)
    """Requests of one session per second in the long run; further ones are answered 429. A busy server allows fewer,
    and announces the rate in its answers.
    """
    sessions_per_address: int = Field(default=64, ge=1)
    """WebTransport sessions of one address; further ones are answered 429."""


class Limits(QuicLimits):
    """All limits of a server. Those below are no settings; they suit frames of up to some megabytes.

    Times are in seconds.
    """

    unvalidated: int = 64
    """Handshakes under way before new clients must prove their address with a Retry (RFC 9000, 8.1)."""
    unvalidated_per_address: int = 8
    """The same, of one address."""
    requests: int = 64
    """Running and incomplete requests per connection, HTTP and WebTransport together; further ones are answered 503, or
    reset if incomplete.
    """
    resets_per_s: float = 480.0
    """Streams of one address a second that are reset before they are answered, in the long run; a second's worth may
    be reset at once. The client may open others in their place no faster than this."""
    sessions: int = 4
    """WebTransport sessions per connection; further ones are answered 429."""
    stream_window: int = 64 * 1024
    """Bytes that a client may send on one stream ahead of the data that was read (QUIC flow control)."""
    unsent: int = 256 * 1024
    """Bytes of a connection's answers that wait in QUIC for the network; more waits in the writer."""
    unread_answers: int = 2 * 1024 * 1024
    """Bytes of a connection's answers that wait for the network and for a client that does not read."""
    waiting_per_address: int = 256 * 1024 * 1024
    """Bytes of an address's answers that wait in writers; streams of further answers are cut."""
    handshake_timeout: float = 5.0
    """For a client to complete the handshake."""
    request_timeout: float = 10.0
    """For a request's headers, for the next part of its body, or for a whole WebTransport request to arrive."""
    stall_timeout: float = 30.0
    """For a client that does not read, before its stream is cut."""
    idle_timeout: float = 30.0
    """For a silent client, before its connection ends."""
    grace: float = 0.5
    """For running requests to finish once the server stops."""

    @classmethod
    def of(cls, settings: QuicLimits) -> Self:
        """The limits with these settings."""
        return cls(**settings.model_dump())

    def of_each(self, edges: int) -> Self:
        """The limits of each of several edges, which count by themselves."""
        counts = (
            "connections", "connections_per_address", "unvalidated", "unvalidated_per_address", "requests_per_address",
            "sessions_per_address", "waiting_per_address",
        )  # fmt: skip
        parts: dict[str, float] = {name: quota(getattr(self, name), edges) for name in counts}
        rates = {name: getattr(self, name) / edges for name in ("handshakes_per_s", "resets_per_s")}
        return self.model_copy(update=parts | rates)
