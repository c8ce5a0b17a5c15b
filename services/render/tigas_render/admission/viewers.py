"""Admission of viewers by one process: how busy it is, its viewers over HTTP, and the rate of each session."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from tigas_render.admission.http_viewers import HttpViewers
from tigas_render.admission.limits import QuicLimits
from tigas_render.admission.load import Load, LoadState
from tigas_render.admission.request_rate import RequestRate


class ViewerAdmission:
    """The state behind every decision of one process that serves viewers."""

    def __init__(self, limits: QuicLimits) -> None:
        self.load = Load(time.monotonic)
        self.rate = RequestRate(self.load, limits.requests_per_s, time.monotonic)
        self.http_viewers = HttpViewers(self.load, time.monotonic)

    @asynccontextmanager
    async def measured(self, report: Callable[[LoadState], None]) -> AsyncIterator[None]:
        """Measure the event loop, as a context manager. `report` gets the state after each measurement."""

        def ticked() -> None:
            self.http_viewers.forget_absent()
            report(self.load.state)

        measuring = asyncio.create_task(self.load.keep(ticked))
        try:
            yield
        finally:
            measuring.cancel()
