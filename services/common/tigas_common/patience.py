"""Timeouts of slow senders."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Patience:
    """Expires after `seconds` without progress, or below a sustained rate of `bytes_per_s`.

    A higher rate does not add up: after any amount of data, silence is limited to `seconds`.
    """

    seconds: float
    bytes_per_s: float
    now: float
    """When it begins, on any clock that counts seconds."""
    until: float = field(init=False)
    """When it ends, on the same clock."""

    def __post_init__(self) -> None:
        self.until = self.now + self.seconds

    def progress(self, size: int, now: float) -> None:
        """Record received bytes."""
        self.until = min(now + self.seconds, self.until + size / self.bytes_per_s)
