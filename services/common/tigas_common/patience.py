"""How long somebody who sends slowly is waited for."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Patience:
    """Lasts `seconds` without progress, and runs out under a lasting rate below `bytes_per_s`.

    What comes faster than that does not add up: however much has come, silence is borne for `seconds` at most.
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
        """So many bytes have come."""
        self.until = min(now + self.seconds, self.until + size / self.bytes_per_s)
