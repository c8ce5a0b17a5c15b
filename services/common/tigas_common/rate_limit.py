"""The token bucket behind every limit on a rate: requests, handshakes, reset streams, and time on the event loop."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Generic, TypeVar

Who = TypeVar("Who", bound=Hashable)


class RateLimit(Generic[Who]):
    """A token bucket for each client. Full buckets are dropped.

    `rate` is the amount per second in the long run, and `burst_s` the number of seconds' worth that may be used at
    once.
    """

    def __init__(self) -> None:
        self._full_at: dict[Who, float] = {}
        """The time at which each bucket is full again, the least recently used first."""

    def __len__(self) -> int:
        return len(self._full_at)

    def delay(self, who: Who, now: float, rate: float, burst_s: float, amount: float = 1.0) -> float:
        """Return the seconds until a client may use this amount."""
        return max(0.0, max(now, self._full_at.get(who, now)) + amount / rate - (now + burst_s))

    def use(self, who: Who, now: float, rate: float, amount: float = 1.0) -> None:
        """Count an amount, allowed or not; a negative one is given back."""
        full_at = max(now, self._full_at.pop(who, now)) + amount / rate
        self._full_at[who] = full_at
        while self._full_at and (first := next(iter(self._full_at.items())))[1] <= now:
            del self._full_at[first[0]]

    def allows(self, who: Who, now: float, rate: float, burst_s: float) -> bool:
        """Return whether a client may act once more now, which is then counted."""
        if self.delay(who, now, rate, burst_s) > 0:
            return False
        self.use(who, now, rate)
        return True
