"""Admission of QUIC connections, and of the sessions, requests and streams that they open."""

from __future__ import annotations

from dataclasses import dataclass

from tigas_common.errors import ServerFull
from tigas_common.limits import RateLimit
from tigas_render.admission.limits import Limits
from tigas_render.admission.load import Load

HANDSHAKE_BURST, HANDSHAKES_PER_S = 2, 25.0
"""Burst and sustained rate of an address's new handshakes, each of which costs the event loop a few milliseconds.
Packets of further handshakes are dropped, and QUIC clients resend them."""


@dataclass(slots=True, eq=False)
class Usage:
    """Open connections, sessions and requests of one address, and its waiting answers."""

    address: str
    connections: int = 0
    sessions: int = 0
    """WebTransport sessions."""
    requests: int = 0
    """Requests that are running or still incomplete."""
    waiting_bytes: int = 0
    """Bytes of answers waiting in writers because the client or the network does not accept them."""

    def request_refusal(self, limits: Limits, running: int) -> str | None:
        """Return the reason, if any, to refuse a request on a connection with this number of running ones."""
        if running >= limits.requests:
            return "This connection has too many running requests."
        if self.requests >= limits.requests_per_address:
            return "Your address has too many running requests."
        return None

    def session_refusal(self, limits: Limits, open_sessions: int) -> str | None:
        """Return the reason, if any, to refuse a session on a connection with this number of open ones."""
        if open_sessions >= limits.sessions:
            return "This connection has the maximum number of sessions."
        if self.sessions >= limits.sessions_per_address:
            return "Your address has the maximum number of sessions."
        return None


class ConnectionAdmission:
    """Decides when addresses may open connections, and replace streams that they have reset."""

    def __init__(self, limits: Limits, load: Load) -> None:
        self._limits = limits
        self._load = load
        self._connection_rate = RateLimit[str]()
        self._handshake_rate = RateLimit[str]()
        self._reset_rate = RateLimit[str]()

    def must_prove_address(self, handshaking: int, address_handshaking: int) -> bool:
        """Whether a new client gets a Retry first, given the numbers of unfinished handshakes: all, and per address."""
        return handshaking >= self._limits.unvalidated or address_handshaking >= self._limits.unvalidated_per_address

    def try_begin_handshake(self, address: str, now: float) -> bool:
        """Whether an address may begin a handshake now, which counts it; if not, its packet is dropped."""
        return self._handshake_rate.try_acquire(address, now, HANDSHAKES_PER_S, HANDSHAKE_BURST / HANDSHAKES_PER_S)

    def connection_refusal(self, usage: Usage, connections: int, now: float) -> str | None:
        """Return the reason, if any, to refuse another connection from an address.

        connections: number of open connections from all addresses.
        """
        try:
            self._load.check_capacity()
        except ServerFull as error:
            return error.detail
        if connections >= self._limits.connections:
            return "The server has the maximum number of connections; try again later."
        if usage.connections >= self._limits.connections_per_address:
            return "Your address has the maximum number of connections; close some."
        rate = self._limits.handshakes_per_s
        if not self._connection_rate.try_acquire(usage.address, now, rate, self._limits.connections_per_address / rate):
            return "Your address opens connections too fast; try again in a second."
        return None

    def reset_delay(self, address: str, now: float) -> float:
        """Return the seconds until an address may replace a stream that it has reset; 0 counts as a replacement."""
        rate = self._limits.resets_per_s
        delay = self._reset_rate.delay_s(address, now, rate, burst_s=max(1.0, 1 / rate))
        if not delay:
            self._reset_rate.consume(address, now, rate)
        return delay
