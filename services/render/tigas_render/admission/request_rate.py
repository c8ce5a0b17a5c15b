"""The rate of requests of each session: as announced to it, with some slack, or above that of any display."""

from __future__ import annotations

from collections.abc import Callable

from tigas_common.errors import AskedTooOften
from tigas_common.limits import RateLimit
from tigas_render.admission.load import Load
from tigas_render.frame import Client

SLACK = 1.25
"""The tolerated excess over the announced rate: clocks differ, and announcements take time."""
BURST_S, LEAST_BURST = 0.25, 4
"""Burst in seconds, and its minimum in requests: the network bunches them."""


class RequestRate:
    """A token bucket of requests for each session."""

    def __init__(self, load: Load, most: float, clock: Callable[[], float]) -> None:
        """most: requests of a session a second on an idle server."""
        self._load = load
        self._most = most
        self._clock = clock
        self._limit = RateLimit[Client]()

    @property
    def told(self) -> float | None:
        """The announced rate in requests a second; None if a client may ask as often as its display refreshes."""
        return self._load.requests_per_s

    def allows(self, client: Client) -> bool:
        """Return whether a session may make a request now, which is then counted."""
        rate = self._rate
        return self._limit.allows(client, self._clock(), rate, max(LEAST_BURST / rate, BURST_S))

    def check(self, client: Client) -> None:
        """Count a request of a session. Raises AskedTooOften."""
        if not self.allows(client):
            raise self.error

    @property
    def error(self) -> AskedTooOften:
        """The error for a session that asks too often."""
        return AskedTooOften(
            f"This session asks more than {self.told or self._most:.0f} times a second; ask less often.", 1 / self._rate
        )

    @property
    def _rate(self) -> float:
        told = self.told
        return self._most if told is None else min(self._most, SLACK * told)
