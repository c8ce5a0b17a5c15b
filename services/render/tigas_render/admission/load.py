"""The control loop of admission. It measures an event loop, and decides on new viewers, their rate, and old datagrams.

Ten times a second, `tick` classifies the last tenth of a second as *bad* if the utilisation was at least FULL_AT, if
most datagrams were late (a standing queue), or if the engine was full; and as *hot* if the utilisation was above HOT_AT
or there was a standing queue. Counters turn ticks into states, so that no viewer is refused because of a single pause:

- With SURPLUS_TICKS more bad ticks than good ones, the process is *full* until CALM_TICKS in a row are calm:
  utilisation below FREE_AT and no queue.
- With SURPLUS_TICKS more hot ticks than others, the allowed rate is multiplied by RATE_DECREASE; after SURPLUS_TICKS
  cool ticks in a row, by RATE_INCREASE.

Utilisation is the share of time in which the loop's thread computes or waits for a processor. It rises early, but does
not show when other threads hold the interpreter's lock; the age of datagrams does. A new viewer counts with its
expected cost until the real one has been measured (SETTLED_S), so that a crowd is not admitted all at once.
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
SMOOTHING_S, MAX_TICK_S = 1.0, 0.3
"""Time constant of the average utilisation, and the longest that one pause counts in it, in seconds."""
FULL_AT, FREE_AT = 0.85, 0.7
"""Utilisation at which the process is full, and below which it may be free again."""
HOT_AT = 0.92
"""Utilisation above which the rate of admitted viewers is cut."""
LATE_S = 0.01
"""Age in seconds above which a datagram counts as late when it is handled."""
MIN_DATAGRAMS = 3
"""Minimum number of datagrams in a tick that can reveal a standing queue."""
TURN_LATE_S, ENGINE_FULL_AT = 0.06, 0.95
"""The engine is full if a client waits longer than this for its turn, in seconds, and utilisation is above this."""
ALWAYS_ADMITTED = 8
"""Number of viewers that are always admitted, without a rate limit: they cannot keep the machine busy."""
SURPLUS_TICKS, CALM_TICKS = 5, 20
"""Surplus of bad ticks that makes the process full, and number of calm ticks in a row that makes it free again."""
SETTLED_S = 2.0
"""Seconds after which a new viewer's cost is part of the measured utilisation."""
EXPECTED_COST = 0.03
"""Expected utilisation per viewer, until a few have been measured."""
RETRY_S = 5.0
"""Seconds after which a refused viewer may try again."""
RATE_DECREASE, RATE_INCREASE = 0.8, 1.1
"""Factors by which the allowed rate falls and rises, at most once every SURPLUS_TICKS ticks."""
FIRST_RATE, MIN_RATE, MAX_RATE = 60.0, 5.0, 120.0
"""Requests per second: the rate before the first cut, the lowest rate, and the rate above which there is no limit."""
PROMISED_RATE = 30.0
"""Allowed rate in requests per second below which no new viewer is admitted."""
MAX_AGE_S, STANDING_AGE_S = 1.0, 0.1
"""Ages in seconds above which datagrams are dropped, normally and with a standing queue. To QUIC they are lost."""
WINDOW_TICKS = 10
"""Number of ticks over which the largest age is reported."""


def busy_time() -> float:
    """Seconds for which the calling thread has computed or waited for a processor; without schedstat, only computed.

    Waiting counts because a loop that has to share its processor is as busy as one that computes all the time.
    """
    try:
        on_processor, waiting, _ = SCHEDSTAT.read_bytes().split()
    except (OSError, ValueError):
        return time.thread_time()
    return (int(on_processor) + int(waiting)) / 1e9


@dataclass(frozen=True, slots=True)
class LoadState:
    """Measurements and decisions of one process. The counters count from its start."""

    utilisation: float
    """Utilisation of the event loop's thread, 0 to 1."""
    engine_utilisation: float
    """Utilisation of the renderer, 0 to 1."""
    ages: dict[str, float]
    """The largest recent age in each queue, in seconds, by name: `datagrams`, `loop`, `engine`."""
    viewers: int
    full: float | None
    """Seconds after which a new viewer may try again; None if it would be admitted."""
    requests_per_s: float | None
    """The allowed rate of each viewer; None without a limit."""
    refused: int
    """Number of refused viewers."""
    stale: int
    """Number of datagrams dropped because of their age."""
    refused_batches: int
    """Number of datagram batches that the kernel refused, so that they were sent one by one."""


class Load:
    """The load of one event loop. Call all methods in the loop's thread, and keep `run` running."""

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, busy_clock: Callable[[], float] = busy_time
    ) -> None:
        """clock: time in seconds. busy_clock: seconds for which the loop's thread has been busy."""
        self._clock = clock
        self._busy_clock = busy_clock
        self._ticked_at, self._busy = clock(), busy_clock()
        self._utilisation = 0.0
        self._engine_age = self._engine_utilisation = 0.0
        self._handled = self._late = 0
        """Number of datagrams in this tick, and of late ones among them."""
        self._oldest = 0.0
        """The largest age of a datagram in this tick, in seconds."""
        self._ages: deque[tuple[float, float, float]] = deque(maxlen=WINDOW_TICKS)
        """For each tick: the largest age of a datagram, the delay of the loop, and the wait for the engine."""
        self._queue_surplus = self._bad_surplus = self._calm_ticks = 0
        """Surplus of ticks with a standing queue, surplus of bad ticks, and number of calm ticks in a row."""
        self._hot_surplus = self._cool_ticks = 0
        """Surplus of hot ticks, and number of cool ticks in a row."""
        self._full = False
        self._rate: float | None = None
        self._new_viewers: deque[float] = deque()
        """Arrival times of viewers with a cost that is not measured yet."""
        self.viewers = 0
        """Number of viewers now."""
        self._refused = self._stale = self._refused_batches = 0

    async def run(self, on_tick: Callable[[], None] = lambda: None) -> None:
        """Measure until cancelled, and call `on_tick` after each measurement."""
        while True:
            await asyncio.sleep(TICK_S)
            self.tick()
            on_tick()

    def accept_datagram(self, age: float) -> bool:
        """Count a datagram of this age in seconds; False if it must be dropped."""
        self._handled += 1
        self._late += age > LATE_S
        self._oldest = max(self._oldest, age)
        if age <= (STANDING_AGE_S if self._queue_surplus >= SURPLUS_TICKS else MAX_AGE_S):
            return True
        self._stale += 1
        return False

    def record_engine(self, queue_age_s: float, utilisation: float) -> None:
        """Record the longest wait for the renderer, in seconds, and the renderer's utilisation."""
        self._engine_age, self._engine_utilisation = queue_age_s, utilisation

    def add_viewer(self) -> None:
        self.viewers += 1
        self._new_viewers.append(self._clock())

    def count_refused_batch(self) -> None:
        self._refused_batches += 1

    def tick(self) -> None:
        """Measure and decide. Called every TICK_S."""
        now, busy = self._clock(), self._busy_clock()
        elapsed = max(1e-6, now - self._ticked_at)
        share = min(1.0, (busy - self._busy) / elapsed)
        counts = min(elapsed, MAX_TICK_S)
        self._utilisation += (1 - math.exp(-counts / SMOOTHING_S)) * (share - self._utilisation)
        has_queue = self._handled >= MIN_DATAGRAMS and 2 * self._late > self._handled
        self._ages.append((self._oldest, max(0.0, elapsed - TICK_S), self._engine_age))
        self._ticked_at, self._busy = now, busy
        self._handled, self._late, self._oldest = 0, 0, 0.0
        self._queue_surplus = _update_surplus(self._queue_surplus, has_queue)
        self._update_full(has_queue)
        self._update_rate(has_queue)

    def _update_full(self, has_queue: bool) -> None:
        engine_full = self._engine_utilisation > ENGINE_FULL_AT and self._engine_age > TURN_LATE_S
        self._bad_surplus = _update_surplus(self._bad_surplus, has_queue or engine_full or self._utilisation >= FULL_AT)
        slowed = self._rate is not None and self._rate < PROMISED_RATE
        calm = not (has_queue or engine_full or slowed) and self._utilisation < FREE_AT
        self._calm_ticks = self._calm_ticks + 1 if calm else 0
        if self._bad_surplus >= SURPLUS_TICKS:
            self._full = True
        elif self._calm_ticks >= CALM_TICKS:
            self._full = False

    def _update_rate(self, has_queue: bool) -> None:
        """Cut the rate quickly and raise it slowly, like congestion control."""
        hot = has_queue or self._utilisation > HOT_AT
        self._hot_surplus = _update_surplus(self._hot_surplus, hot)
        self._cool_ticks = self._cool_ticks + 1 if not hot and self._utilisation < FULL_AT else 0
        if self._hot_surplus >= SURPLUS_TICKS:
            self._hot_surplus = 0
            self._rate = max(MIN_RATE, RATE_DECREASE * (self._rate or FIRST_RATE))
        elif self._cool_ticks >= SURPLUS_TICKS and self._rate is not None:
            self._cool_ticks = 0
            self._rate = RATE_INCREASE * self._rate if RATE_INCREASE * self._rate < MAX_RATE else None

    def retry_after_s(self) -> float | None:
        """Return the seconds after which a new viewer may try again, or None to admit it."""
        if self.viewers < ALWAYS_ADMITTED:
            return None
        return RETRY_S if self._full or self._expected_utilisation() >= FULL_AT else None

    def check_capacity(self) -> None:
        """Raise ServerFull, and count it, unless a new viewer can be admitted."""
        if (retry_after_s := self.retry_after_s()) is not None:
            self._refused += 1
            raise ServerFull("The server is full; try again in a few seconds.", retry_after_s)

    @property
    def requests_per_s(self) -> float | None:
        """The currently allowed rate of each viewer; None without a limit."""
        return self._rate if self.viewers > ALWAYS_ADMITTED else None

    @property
    def state(self) -> LoadState:
        """The state for metrics and for other processes."""
        ages = [max(column, default=0.0) for column in zip(*self._ages, strict=True)] or [0.0] * 3
        return LoadState(
            utilisation=self._utilisation,
            engine_utilisation=self._engine_utilisation,
            ages=dict(zip(("datagrams", "loop", "engine"), ages, strict=True)),
            viewers=self.viewers,
            full=self.retry_after_s(),
            requests_per_s=self.requests_per_s,
            refused=self._refused,
            stale=self._stale,
            refused_batches=self._refused_batches,
        )

    def _expected_utilisation(self) -> float:
        """Return the utilisation to expect once the cost of new viewers has been measured."""
        settled = self._clock() - SETTLED_S
        while self._new_viewers and self._new_viewers[0] < settled:
            self._new_viewers.popleft()
        known = max(0, self.viewers - len(self._new_viewers))
        of_known = self._utilisation if known else 0.0  # with new viewers only, their arrival keeps the loop busy
        each = (of_known + ALWAYS_ADMITTED * EXPECTED_COST) / (known + ALWAYS_ADMITTED)
        return self._utilisation + each * len(self._new_viewers)


def _update_surplus(count: int, bad: bool) -> int:
    """Update the surplus of bad ticks over good ones, bounded so that the distant past is forgotten."""
    return min(count + 1, 2 * SURPLUS_TICKS) if bad else max(0, count - 1)
