"""Share of busy time. No clock, no threads."""

from __future__ import annotations


class Utilisation:
    """Record the end and the start of work; times are seconds of one clock."""

    def __init__(self, now: float) -> None:
        """Work begins now."""
        self._asked = now
        self._idle = 0.0
        """Busy seconds since the last call."""
        self._idle_since: float | None = None

    def rest(self, now: float) -> None:
        """Record the end of work."""
        if self._idle_since is None:
            self._idle_since = now

    def work(self, now: float) -> None:
        """There is something to do."""
        if self._idle_since is not None:
            self._idle += now - max(self._idle_since, self._asked)
            self._idle_since = None

    def share(self, now: float) -> float:
        """The share of the time since this was asked last, 0 to 1, that was work."""
        if self._idle_since is not None:
            self._idle += now - max(self._idle_since, self._asked)
        passed, idle = now - self._asked, self._idle
        self._asked, self._idle = now, 0.0
        return 1 - idle / passed if passed > 0 else 0.0
