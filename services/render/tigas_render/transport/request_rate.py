"""How often each session may ask: what it was told, with some slack, or else more often than any display shows."""

from __future__ import annotations

from collections.abc import Callable

from tigas_common.errors import AskedTooOften
from tigas_render.frame import Client
from tigas_render.transport.load import Load

SLACK = 1.25
"""A session may ask so many times as often as it was told: its clock is another, and the news needs time."""
BURST_S, LEAST_BURST = 0.25, 4
"""So many seconds' requests may come at once, and at least so many: the network gathers them."""


class RequestRate:
    """A token bucket for each session. Sessions that are quiet cost nothing."""

    def __init__(self, load: Load, most: float, clock: Callable[[], float]) -> None:
        """most: requests of a session a second, however idle the server is."""
        self._load = load
        self._most = most
        self._clock = clock
        self._full_at: dict[Client, float] = {}
        """When each bucket is full again; whoever asked the longest ago is first."""

    def __len__(self) -> int:
        return len(self._full_at)

    @property
    def told(self) -> float | None:
        """What a client is told: requests a second, or None if it may ask as often as a display shows."""
        return self._load.requests_per_s

    def allows(self, client: Client) -> bool:
        """Whether a session may ask once more now, which then counts."""
        told = self.told
        rate = self._most if told is None else min(self._most, SLACK * told)
        burst = max(LEAST_BURST / rate, BURST_S)
        now = self._clock()
        full_at = max(now, self._full_at.get(client, now)) + 1 / rate
        if full_at > now + burst:
            return False
        self._full_at.pop(client, None)
        self._full_at[client] = full_at
        while self._full_at and (first := next(iter(self._full_at.items())))[1] <= now:
            del self._full_at[first[0]]
        return True

    def check(self, client: Client) -> None:
        """Raises AskedTooOften if a session may not."""
        if not self.allows(client):
            raise self.error

    @property
    def error(self) -> AskedTooOften:
        """What a session hears that asks too often."""
        return AskedTooOften(
            f"This session asks more than {self.told or self._most:.0f} times a second; ask less often."
        )
