"""How much one client, and all clients together, may ask of the server."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Limits:
    """The defaults suit frames of up to some megabytes and a few hundred viewers. Times are in seconds."""

    connections: int = 512
    """Connections at once; further ones are ignored until others end."""
    unvalidated: int = 64
    """Handshakes under way before new clients must prove their address with a Retry (RFC 9000, 8.1)."""
    requests: int = 64
    """Running requests per connection, HTTP and WebTransport together, with those that have not arrived whole; further
    ones are answered 503, or reset if they have not arrived whole."""
    sessions: int = 4
    """WebTransport sessions per connection."""
    unread: int = 256 * 1024
    """Bytes of one request body that wait for the application; a client that sends more is cut."""
    stream_window: int = 64 * 1024
    """Bytes that a client may send on one stream ahead of what has arrived in order (QUIC flow control)."""
    unsent: int = 256 * 1024
    """Bytes of a connection's answers that wait in QUIC for the network; more waits with whoever writes it."""
    unread_answers: int = 2 * 1024 * 1024
    """The same, with those that wait for a client that does not read them."""
    handshake_timeout: float = 5.0
    """For a client to complete the handshake."""
    request_timeout: float = 10.0
    """For a request's headers, for the next part of its body, or for a whole WebTransport request to arrive."""
    stall_timeout: float = 30.0
    """For a client that reads nothing, before its stream is cut."""
    idle_timeout: float = 30.0
    """For a client that says nothing at all, before its connection ends."""
    grace: float = 0.5
    """For running requests to finish once the server stops."""
