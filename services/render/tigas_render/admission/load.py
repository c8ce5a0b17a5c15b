"""The control loop of admission: it measures an event loop, and decides on new viewers, their rate, and old datagrams.

Ten times a second, `tick` classifies the last tenth: it was *bad* if the utilisation was at least FULL_AT, if most
datagrams were late (a standing queue), or if the engine was full; it was *hot* above HOT_AT or with a standing queue.
Counters turn ticks into states, so that a single pause, however long, refuses no one:

- LASTING more bad ticks than good ones: *full*, until CALM ticks in a row were calm (below FREE_AT, no queue).
- LASTING more hot ticks than others: the allowed rate is multiplied by CUT. LASTING cool ticks in a row: by GROWTH.

Utilisation is the share of time in which the thread of the loop computes or waits for a processor. It rises early, but
misses threads that hold the interpreter; the age of datagrams shows these. New viewers count with their expected cost
until it has been measured (SETTLED_S), so that a crowd is not admitted at once.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tigas_common.errors import ServerFull

SCHEDSTAT = Path("/proc/thread-self/schedstat")
"""Nanoseconds on a processor, nanoseconds of waiting for one, and a count (Linux: scheduler/sched-stats)."""
TICK_S = 0.1
"""Seconds between measurements."""
SMOOTHING_S, MOST_TICK_S = 1.0, 0.3
"""Time constant of the average utilisation, and the most that one pause counts in it, in seconds."""
FULL_AT, FREE_AT = 0.85, 0.7
"""Utilisation at which the process is full, and below which it may be free again."""
HOT_AT = 0.92
"""Utilisation above which the rate of admitted viewers is cut."""
LATE_S = 0.01
"""The age in seconds from which on a datagram is late when it is handled."""
ENOUGH = 3
"""The least number of datagrams in a tick that can show a standing queue."""
TURN_LATE_S, ENGINE_FULL_AT = 0.06, 0.95
"""The engine is full above this wait for a client's turn, in seconds, and above this utilisation."""
FEW = 8
"""This many viewers are always admitted, at any rate: they cannot keep the machine busy."""
LASTING, CALM = 5, 20
"""Surplus of bad ticks that makes the process full, and calm ticks in a row that make it free."""
SETTLED_S = 2.0
"""Seconds after which the cost of a new viewer is part of the measured utilisation."""
EXPECTED_COST = 0.03
"""The expected utilisation by one viewer, until a few have been measured."""
RETRY_S = 5.0
"""Seconds after which a refused viewer may try again."""
CUT, GROWTH = 0.8, 1.1
"""Factors by which the allowed rate falls and rises, every LASTING ticks."""
FIRST_RATE, LEAST_RATE, MOST_RATE = 60.0, 5.0, 120.0
"""Requests a second: the rate before the first cut, the lowest rate, and the rate above which there is no limit."""
PROMISED_RATE = 30.0
"""No viewer is admitted while the allowed rate is lower than this, in requests a second."""
MAX_AGE_S, STANDING_AGE_S = 1.0, 0.1
"""Ages in seconds above which datagrams are dropped: after a pause, and while a queue stands. QUIC sees loss."""
WINDOW_TICKS = 10
"""The number of ticks over which the largest age is reported."""


def busy_time() -> float:
    """Seconds for which the calling thread has computed or waited for a processor; if that is unknown, computed.

    A loop that shares its processor with others is as busy as one that computes all the time.
    """
    try:
        on_processor, waiting, _ = SCHEDSTAT.read_bytes().split()
    except (OSError, ValueError):
        return time.thread_time()
    return (int(on_processor) + int(waiting)) / 1e9


@dataclass(frozen=True, slots=True)
class LoadState:
    """The measurements and decisions of a process."""

    utilisation: float
    """Of the event loop's thread, 0 to 1."""
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
    """Refused viewers since the start."""
    stale: int
    """Datagrams dropped for their age since the start."""
    refused_batches: int
    """Batches of datagrams that the kernel refused since the start, so that they were sent one by one."""


class Load:
    """The load of one event loop. All methods run in the loop's thread, and `keep` must be running."""

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, busy_clock: Callable[[], float] = busy_time
    ) -> None:
        """clock, busy_clock: seconds, and seconds of work of the loop's thread."""
        self._clock = clock
        self._busy_clock = busy_clock
        self._ticked_at, self._busy = clock(), busy_clock()
        self._utilisation = 0.0
        self._engine_age = self._engine_utilisation = 0.0
        self._handled = self._late = 0
        """Datagrams of this tick, and the late ones among them."""
        self._oldest = 0.0
        """Their largest age."""
        self._ages: deque[tuple[float, float, float]] = deque(maxlen=WINDOW_TICKS)
        """The largest age of a datagram, the lateness of the loop, and the wait for the engine, by tick."""
        self._stands = self._presses = self._calms = 0
        """Surpluses of ticks with a standing queue, and of bad ones, and the number of calm ones in a row."""
        self._heats = self._cools = 0
        """The surplus of hot ticks, and the number of cool ones in a row."""
        self._full = False
        self._rate: float | None = None
        self._entered: deque[float] = deque()
        """Arrival times of viewers without a measured cost."""
        self.viewers = 0
        """Present viewers."""
        self._refused = self._stale = self._refused_batches = 0

    async def keep(self, ticked: Callable[[], None] = lambda: None) -> None:
        """Measure until cancelled, and call `ticked` after each measurement."""
        while True:
            await asyncio.sleep(TICK_S)
            self.tick()
            ticked()

    def handled(self, age: float) -> bool:
        """Count a datagram by its age in seconds, and return whether to handle it, or drop it."""
        self._handled += 1
        self._late += age > LATE_S
        self._oldest = max(self._oldest, age)
        if age <= (STANDING_AGE_S if self._stands >= LASTING else MAX_AGE_S):
            return True
        self._stale += 1
        return False

    def engine(self, queue_age_s: float, utilisation: float) -> None:
        """Note how long a client waits for its turn at the renderer, in seconds, and the renderer's utilisation."""
        self._engine_age, self._engine_utilisation = queue_age_s, utilisation

    def entered(self) -> None:
        self.viewers += 1
        self._entered.append(self._clock())

    def batch_refused(self) -> None:
        self._refused_batches += 1

    def tick(self) -> None:
        """Measure, every TICK_S."""
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
        """Cut the rate fast and raise it slowly, as congestion control does."""
        hot = stands or self._utilisation > HOT_AT
        self._heats = _more(self._heats, hot)
        self._cools = self._cools + 1 if not hot and self._utilisation < FULL_AT else 0
        if self._heats >= LASTING:
            self._heats = 0
            self._rate = max(LEAST_RATE, CUT * (self._rate or FIRST_RATE))
        elif self._cools >= LASTING and self._rate is not None:
            self._cools = 0
            self._rate = GROWTH * self._rate if GROWTH * self._rate < MOST_RATE else None

    def full(self) -> float | None:
        """Return the seconds after which a new viewer may try again, or None to admit it."""
        if self.viewers < FEW:
            return None
        return RETRY_S if self._full or self._expected() >= FULL_AT else None

    def check(self) -> None:
        """Raise ServerFull, which is counted, unless a new viewer is admitted."""
        if (retry_after_s := self.full()) is not None:
            self._refused += 1
            raise ServerFull("The server is full; try again in a few seconds.", retry_after_s)

    @property
    def requests_per_s(self) -> float | None:
        """The allowed rate of each viewer now; None without a limit."""
        return self._rate if self.viewers > FEW else None

    @property
    def state(self) -> LoadState:
        """The state for metrics and for other processes."""
        ages = [max(column, default=0.0) for column in zip(*self._ages, strict=True)] or [0.0] * 3
        return LoadState(
            utilisation=self._utilisation,
            engine_utilisation=self._engine_utilisation,
            ages=dict(zip(("datagrams", "loop", "engine"), ages, strict=True)),
            viewers=self.viewers,
            full=self.full(),
            requests_per_s=self.requests_per_s,
            refused=self._refused,
            stale=self._stale,
            refused_batches=self._refused_batches,
        )

    def _expected(self) -> float:
        """Return the expected utilisation once the cost of new viewers is measured."""
        settled = self._clock() - SETTLED_S
        while self._entered and self._entered[0] < settled:
            self._entered.popleft()
        known = max(0, self.viewers - len(self._entered))
        of_known = self._utilisation if known else 0.0  # else their arrival keeps the loop busy
        each = (of_known + FEW * EXPECTED_COST) / (known + FEW)
        return self._utilisation + each * len(self._entered)


def _more(count: int, bad: bool) -> int:
    """Update the surplus of bad ticks over good ones, bounded so that the distant past is forgotten."""
    return min(count + 1, 2 * LASTING) if bad else max(0, count - 1)
