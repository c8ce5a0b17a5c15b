"""A lock that says who waits for it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Self


class Turns:
    """Heavy work in turn, one piece at a time: `async with turns`."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """clock: in seconds."""
        self._clock = clock
        self._lock = asyncio.Lock()
        self._waiting: list[float] = []
        """Since when."""

    @property
    def waiting(self) -> int:
        """How many wait for their turn."""
        return len(self._waiting)

    @property
    def working(self) -> bool:
        """Whether it is somebody's turn."""
        return self._lock.locked()

    @property
    def age_s(self) -> float:
        """How long they have waited who have waited longest, in seconds."""
        return self._clock() - min(self._waiting) if self._waiting else 0.0

    async def __aenter__(self) -> Self:
        since = self._clock()
        self._waiting.append(since)
        try:
            await self._lock.acquire()
        finally:
            self._waiting.remove(since)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._lock.release()
