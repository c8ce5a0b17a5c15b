"""Assigns each session of a scene to one of its engines, stably and evenly. No sockets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from typing import Final

GONE_S: Final = 5.0
"""Seconds without a request after which a session no longer counts."""


class Sharing:
    """The sessions of one scene."""

    def __init__(self) -> None:
        self._engines: dict[Hashable, tuple[str, float]] = {}
        """Each session's engine, and when it asked last."""
        self._counts: Counter[str] = Counter()

    def choose(self, session: Hashable, engines: Sequence[str], now: float) -> str:
        """The engine to ask, among these, best first.

        A session moves only if its engine is not among them, or has more sessions than its share.
        """
        kept = self._engines.get(session)
        if kept is not None and kept[0] in engines and self._counts[kept[0]] <= self._part(engines):
            chosen = kept[0]
        else:
            if kept is not None:
                self._counts[kept[0]] -= 1
            chosen = min(engines, key=lambda engine: self._counts[engine])
            self._counts[chosen] += 1
        self._engines[session] = chosen, now
        return chosen

    def forget(self, now: float) -> bool:
        """Drop ended sessions; whether any are left."""
        for session in [session for session, (_, at) in self._engines.items() if now - at >= GONE_S]:
            engine, _ = self._engines.pop(session)
            self._counts[engine] -= 1
        return bool(self._engines)

    def _part(self, engines: Sequence[str]) -> int:
        return -(-sum(self._counts[engine] for engine in engines) // len(engines))
