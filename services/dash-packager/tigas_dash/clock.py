"""The packager's clock: wall-clock time without jumps."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta


@dataclass(frozen=True, slots=True)
class Clock:
    """Wall-clock time, read once at the start and continued by the monotonic clock.

    The manifest, producer reference times and the time given to players (UTCTiming) all come from here, so that media
    time and wall-clock time stay locked even if the machine's clock is set.
    """

    _wall: datetime = field(default_factory=lambda: datetime.now(UTC))
    _monotonic: float = field(default_factory=time.monotonic)

    def now(self) -> float:
        return time.monotonic()

    async def sleep_until(self, moment: float) -> None:
        """Sleep until a time on the monotonic clock; a past time yields to other tasks."""
        await asyncio.sleep(max(0.0, moment - self.now()))

    def wall_time(self, at: float) -> datetime:
        """The wall-clock time at a time on the monotonic clock."""
        return self._wall + timedelta(seconds=at - self._monotonic)

    def wall_now(self) -> datetime:
        return self.wall_time(self.now())


def xs_datetime(moment: datetime) -> str:
    """Format as xs:dateTime with milliseconds, such as 2026-01-31T12:00:00.000Z."""
    return moment.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
