"""The load of the machine during a run: with saturated processors, latencies tell of it, not of the network."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

import psutil

from tigas_common.wire.model import WireModel

EVERY_S = 0.5
SATURATED = 0.95
"""Above this share of busy processor time, work waits for a processor."""
TOO_OFTEN = 0.1
"""A run with more saturated samples than this share is marked."""


class LoadSample(WireModel):
    """One moment."""

    unix_ms: float
    cpu: float
    """Busy share of all processors since the sample before, 0 to 1."""
    load_average: float
    """Of the last minute: processes that run or want to."""


class Load(WireModel):
    """A whole run."""

    cpu_mean: float
    cpu_max: float
    saturated_share: float
    """Share of the samples above SATURATED."""
    load_average_max: float
    processors: int

    @property
    def saturated(self) -> bool:
        """Whether the figures have to be doubted."""
        return self.saturated_share > TOO_OFTEN

    @classmethod
    def of(cls, samples: Sequence[LoadSample]) -> Load | None:
        """None without samples."""
        if not samples:
            return None
        return cls(
            cpu_mean=sum(sample.cpu for sample in samples) / len(samples),
            cpu_max=max(sample.cpu for sample in samples),
            saturated_share=sum(sample.cpu > SATURATED for sample in samples) / len(samples),
            load_average_max=max(sample.load_average for sample in samples),
            processors=psutil.cpu_count() or 1,
        )


@asynccontextmanager
async def watching_load(keep: int | None = None) -> AsyncIterator[deque[LoadSample]]:
    """Grows by a sample every EVERY_S for as long as the context lasts, up to the newest `keep`."""
    samples: deque[LoadSample] = deque(maxlen=keep)

    async def watch() -> None:
        psutil.cpu_percent()
        while True:
            await asyncio.sleep(EVERY_S)
            samples.append(
                LoadSample(
                    unix_ms=time.time() * 1000,
                    cpu=psutil.cpu_percent() / 100,
                    load_average=psutil.getloadavg()[0],
                )
            )

    task = asyncio.create_task(watch())
    try:
        yield samples
    finally:
        task.cancel()
