"""What each address uses of the server: counted while it has connections, and how often it may open one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True, eq=False)
class Usage:
    """One address's share, which its connections count together."""

    address: str
    connections: int = 0
    sessions: int = 0
    """WebTransport sessions."""
    requests: int = 0
    """Running ones, and those that have not arrived whole."""


class RateLimit:
    """Lets everybody do something `rate` times a second in the long run, and `burst` times at once (a token bucket)."""

    def __init__(self, rate: float, burst: int) -> None:
        self._rate = rate
        self._burst = burst
        self._full_at: dict[str, float] = {}
        """When everybody's bucket is full again; whoever did something the longest ago is first."""

    def __len__(self) -> int:
        return len(self._full_at)

    def allows(self, who: str, now: float) -> bool:
        """Whether somebody may do it once more now, which then counts."""
        full_at = max(now, self._full_at.get(who, now)) + 1 / self._rate
        if full_at > now + self._burst / self._rate:
            return False
        self._full_at.pop(who, None)
        self._full_at[who] = full_at
        while (first := next(iter(self._full_at.items())))[1] <= now:
            del self._full_at[first[0]]
        return True
