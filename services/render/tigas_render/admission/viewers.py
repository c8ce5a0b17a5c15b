"""Admission of viewers by one process: its load, its viewers over HTTP, and the request rate of each session."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Final

from tigas_common.errors import AskedTooOften
from tigas_common.limits import RateLimit
from tigas_render.admission.limits import QuicLimits
from tigas_render.admission.load import Load, LoadState
from tigas_render.frame import Client

SLACK = 1.25
"""Tolerated excess over the announced rate, because clocks differ and announcements take time to arrive."""
BURST_S, MIN_BURST = 0.25, 4
"""Burst in seconds, and its minimum in requests, because the network bunches requests."""
STAY_S = 30.0
"""Seconds for which a viewer over HTTP stays admitted after its last request."""
MAX_NAMES_PER_ADDRESS: Final = 64
"""Maximum number of viewers over HTTP distinguished per address, equal to its sessions; further ones count as one."""


class ViewerAdmission:
    """The admission state of one process that serves viewers."""

    def __init__(self, limits: QuicLimits) -> None:
        self.load = Load(time.monotonic)
        self.rate = RequestRate(self.load, limits.requests_per_s, time.monotonic)
        self.http_viewers = HttpViewers(self.load, time.monotonic)

    @asynccontextmanager
    async def monitor(self, on_state: Callable[[LoadState], None]) -> AsyncIterator[None]:
        """Measure the event loop, as a context manager. `on_state` receives the state after each measurement."""

        def on_tick() -> None:
            self.http_viewers.forget_absent()
            on_state(self.load.state)

        measuring = asyncio.create_task(self.load.run(on_tick))
        try:
            yield
        finally:
            measuring.cancel()


class RequestRate:
    """A token bucket for each session: at the announced rate with some slack, or at `max_rate` without one."""

    def __init__(self, load: Load, max_rate: float, clock: Callable[[], float]) -> None:
        """max_rate: requests per second of a session on an idle server."""
        self._load = load
        self._max_rate = max_rate
        self._clock = clock
        self._limit = RateLimit[Client]()

    @property
    def announced_rate(self) -> float | None:
        """The announced rate in requests per second; None if a client may ask as often as its display refreshes."""
        return self._load.requests_per_s

    def check(self, client: Client) -> None:
        """Count a session's request. Raises AskedTooOften."""
        announced = self.announced_rate
        rate = self._max_rate if announced is None else min(self._max_rate, SLACK * announced)
        if not self._limit.try_acquire(client, self._clock(), rate, max(MIN_BURST / rate, BURST_S)):
            often = f"more than {announced or self._max_rate:.0f} requests a second"
            raise AskedTooOften(f"This session sends {often}; send fewer.", 1 / rate)


class HttpViewers:
    """Viewers that use `POST /render`, and so have no session that could be refused.

    Connections do not identify them either, because browsers open and close these as they like. A viewer is therefore
    a name that it chooses together with its address, or the address alone.
    """

    def __init__(self, load: Load, clock: Callable[[], float]) -> None:
        self._load = load
        self._clock = clock
        self._last_request: dict[tuple[str, str], float] = {}
        """Time of each viewer's last request by address and name, oldest first."""
        self._counts: Counter[str] = Counter()
        """Number of viewers per address."""

    def admit(self, address: str, name: str = "") -> str:
        """Admit a viewer, or record its next request, and return its name: empty if its address has too many names.

        Raises ServerFull for a new viewer while the server is full.
        """
        self.forget_absent()
        if (address, name) not in self._last_request and self._counts.get(address, 0) >= MAX_NAMES_PER_ADDRESS:
            name = ""
        viewer = (address, name)
        if self._last_request.pop(viewer, None) is None:
            self._load.check_capacity()
            self._load.add_viewer()
            self._counts[address] += 1
        self._last_request[viewer] = self._clock()
        return name

    def forget_absent(self) -> None:
        """Forget viewers without a request for STAY_S. Must be called regularly, in case no further request arrives."""
        since = self._clock() - STAY_S
        while self._last_request and (first := next(iter(self._last_request.items())))[1] < since:
            address, _ = first[0]
            del self._last_request[first[0]]
            self._load.viewers -= 1
            self._counts[address] -= 1
            if not self._counts[address]:
                del self._counts[address]
