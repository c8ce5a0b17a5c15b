"""How busy an event loop is, and what follows: whether new viewers are taken, how often each may ask, what is too old.

Two things say that there is too much to do. The share of time for which the loop's thread computes, or waits for a
processor, is known early, but says little where other threads hold the interpreter. The age of datagrams when they are
handled tells that, too, but every pause makes some old: only a queue that stands is too much, where most datagrams are
late for long. Either must last; one pause, however long, refuses nobody.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from tigas_render.transport.busy_clock import busy_time

TICK_S = 0.1
"""How often the loop is measured, in seconds."""
SMOOTHING_S, MOST_TICK_S = 1.0, 0.3
"""Time constant of the utilisation's average, and the most that one pause counts in it, in seconds."""
FULL_AT, FREE_AT = 0.85, 0.7
"""Utilisation from which on no new viewers are taken, and under which they are again."""
HOT_AT = 0.92
"""Utilisation above which those who are in are asked to ask less often."""
LATE_S = 0.01
"""A datagram that is older when it is handled has waited, in seconds."""
ENOUGH = 3
"""Datagrams in a tick from which on they tell whether a queue stands."""
TURN_LATE_S, ENGINE_FULL_AT = 0.06, 0.95
"""The engine is full if it has hardly a pause and a client's turn comes round more slowly than this, in seconds."""
FEW = 8
"""So many viewers are always taken, and told no rate: whatever keeps the machine busy then, it is not they."""
LASTING, CALM = 5, 20
"""So many more bad ticks than good ones, and too much to do is believed; so many calm ones in a row, and it is over."""
SETTLED_S = 2.0
"""Seconds after which what a new viewer costs is part of what is measured."""
EXPECTED_COST = 0.03
"""What a viewer is expected to add to the utilisation, until a few have shown otherwise."""
RETRY_S = 5.0
"""When those who are refused may try again, in seconds."""
CUT, GROWTH = 0.8, 1.1
"""By what the rate that is allowed to each viewer falls and rises, every LASTING ticks."""
FIRST_RATE, LEAST_RATE, MOST_RATE = 60.0, 5.0, 120.0
"""Requests a second: the allowed rate before the first cut, the least, and the one above which there is none."""
PROMISED_RATE = 30.0
"""Nobody new is taken while those who are in may not ask so many times a second."""
MAX_AGE_S, STANDING_AGE_S = 1.0, 0.1
"""Older datagrams are dropped, in seconds: after a pause, and while a queue stands. QUIC sees loss."""
WINDOW_TICKS = 10
"""The ages that are shown are the largest of so many ticks."""

FULL = "The server is full; try again in a few seconds."


@dataclass(frozen=True, slots=True)
class LoadState:
    """What a process says of itself, once a second or so."""

    utilisation: float
    """Of the event loop's thread, 0 to 1: the share of time in which it computes, or waits for a processor."""
    engine_utilisation: float
    """Of the renderer, 0 to 1."""
    ages: dict[str, float]
    """The largest recent age in each queue, in seconds, by its name: `datagrams`, `loop`, `engine`."""
    viewers: int
    full: float | None
    """As `Load.full`."""
    requests_per_s: float | None
    """As `Load.requests_per_s`."""
    refused: int
    """Viewers that were refused since the start."""
    stale: int
    """Datagrams that were dropped for their age since the start."""


class Load:
    """One event loop's. Everything but the constructor is called on it; `keep` has to run."""

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, busy_clock: Callable[[], float] = busy_time
    ) -> None:
        """clock, busy_clock: seconds, and seconds for which the loop's thread has been at work."""
        self._clock = clock
        self._busy_clock = busy_clock
        self._ticked_at, self._busy = clock(), busy_clock()
        self._utilisation = 0.0
        self._engine_age = self._engine_utilisation = 0.0
        self._handled = self._late = 0
        """Datagrams of this tick, and how many of them were late."""
        self._oldest = 0.0
        """The largest age of them."""
        self._ages: deque[tuple[float, float, float]] = deque(maxlen=WINDOW_TICKS)
        """Of each tick the largest age of a datagram, the loop's own lateness, and the engine's queue."""
        self._stands = self._presses = self._calms = 0
        """How many more ticks lately had a queue that stands, or too much to do; and how many in a row were calm."""
        self._heats = self._cools = 0
        """How many more ticks lately called for a lower rate, and how many in a row for a higher one."""
        self._full = False
        self._rate: float | None = None
        self._entered: deque[float] = deque()
        """When those came in whose cost is not measured yet."""
        self._viewers = 0
        self._refused = self._stale = 0

    # -- what is measured --------------------------------------------------------------------------------------------

    async def keep(self) -> None:
        """Measure until cancelled."""
        while True:
            await asyncio.sleep(TICK_S)
            self.tick()

    def handled(self, age: float) -> bool:
        """A datagram's turn has come, so many seconds after it arrived; whether it is still to be looked at."""
        self._handled += 1
        self._late += age > LATE_S
        self._oldest = max(self._oldest, age)
        if age <= (STANDING_AGE_S if self._stands >= LASTING else MAX_AGE_S):
            return True
        self._stale += 1
        return False

    def engine(self, queue_age_s: float, utilisation: float) -> None:
        """How slowly a client's turn comes round at the renderer, and what share of the time it works."""
        self._engine_age, self._engine_utilisation = queue_age_s, utilisation

    def entered(self) -> None:
        """A new viewer was taken."""
        self._viewers += 1
        self._entered.append(self._clock())

    def left(self) -> None:
        """One of those who were taken is gone."""
        self._viewers -= 1

    def refused(self) -> None:
        """A viewer was not taken."""
        self._refused += 1

    def tick(self) -> None:
        """Measure; to be called every TICK_S."""
        now, busy = self._clock(), self._busy_clock()
        elapsed = max(1e-6, now - self._ticked_at)
        share = min(1.0, (busy - self._busy) / elapsed)
        counts = min(elapsed, MOST_TICK_S)
        self._utilisation += (1 - math.exp(-counts / SMOOTHING_S)) * (share - self._utilisation)
        stands = self._handled >= ENOUGH and 2 * self._late > self._handled
        self._ages.append((self._oldest, max(0.0, elapsed - TICK_S), self._engine_age))
        self._ticked_at, self._busy = now, busy
        self._handled, self._late, self._oldest = 0, 0, 0.0
        self._stands = _more(self._stands, stands)
        self._judge(stands)
        self._adapt(stands)

    def _judge(self, stands: bool) -> None:
        engine_full = self._engine_utilisation > ENGINE_FULL_AT and self._engine_age > TURN_LATE_S
        self._presses = _more(self._presses, stands or engine_full or self._utilisation >= FULL_AT)
        slowed = self._rate is not None and self._rate < PROMISED_RATE
        calm = not (stands or engine_full or slowed) and self._utilisation < FREE_AT
        self._calms = self._calms + 1 if calm else 0
        if self._presses >= LASTING:
            self._full = True
        elif self._calms >= CALM:
            self._full = False

    def _adapt(self, stands: bool) -> None:
        """Let the rate fall at once and rise slowly, as congestion control does."""
        hot = stands or self._utilisation > HOT_AT
        self._heats = _more(self._heats, hot)
        self._cools = self._cools + 1 if not hot and self._utilisation < FULL_AT else 0
        if self._heats >= LASTING:
            self._heats = 0
            self._rate = max(LEAST_RATE, CUT * (self._rate or FIRST_RATE))
        elif self._cools >= LASTING and self._rate is not None:
            self._cools = 0
            self._rate = GROWTH * self._rate if GROWTH * self._rate < MOST_RATE else None

    # -- what follows ------------------------------------------------------------------------------------------------

    def full(self) -> float | None:
        """Seconds after which a new viewer may try again; None if it may come in."""
        if self._viewers < FEW:
            return None
        return RETRY_S if self._full or self._expected() >= FULL_AT else None

    @property
    def requests_per_s(self) -> float | None:
        """How often each viewer may ask now, if it must not ask as often as it likes."""
        return self._rate if self._viewers > FEW else None

    @property
    def state(self) -> LoadState:
        """All of it, for metrics and for other processes."""
        ages = [max(column, default=0.0) for column in zip(*self._ages, strict=True)] or [0.0] * 3
        return LoadState(
            utilisation=self._utilisation,
            engine_utilisation=self._engine_utilisation,
            ages=dict(zip(("datagrams", "loop", "engine"), ages, strict=True)),
            viewers=self._viewers,
            full=self.full(),
            requests_per_s=self.requests_per_s,
            refused=self._refused,
            stale=self._stale,
        )

    def _expected(self) -> float:
        """The utilisation once those have settled who have just come in."""
        settled = self._clock() - SETTLED_S
        while self._entered and self._entered[0] < settled:
            self._entered.popleft()
        known = max(0, self._viewers - len(self._entered))
        of_known = self._utilisation if known else 0.0  # else it is their coming in that keeps the loop busy
        each = (of_known + FEW * EXPECTED_COST) / (known + FEW)
        return self._utilisation + each * len(self._entered)


def _more(count: int, bad: bool) -> int:
    """How many more bad ticks than good ones there were, forgetting what is long past."""
    return min(count + 1, 2 * LASTING) if bad else max(0, count - 1)
