"""The store's Prometheus metrics, and locks that report their queues."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Self

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_common.metrics import labelled_gauge


class MonitoredLock:
    """An asyncio lock that reports its waiting tasks."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """clock: in seconds."""
        self._clock = clock
        self._lock = asyncio.Lock()
        self._waiting: list[float] = []
        """Start times of the waiting tasks."""

    @property
    def waiting(self) -> int:
        return len(self._waiting)

    @property
    def working(self) -> bool:
        return self._lock.locked()

    @property
    def age_s(self) -> float:
        """Longest current wait in seconds."""
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


class StoreMetrics(Collector):
    def __init__(self, results: Path, queues: Mapping[str, MonitoredLock]) -> None:
        """queues: locks by the name of their work."""
        self._results = results
        self._queues = queues
        self.runs = 0
        """Number of stored runs."""
        self.received_bytes = 0
        """Bytes of uploaded runs and pictures, including refused ones."""

    def collect(self) -> Iterator[Metric]:
        yield CounterMetricFamily("tigas_store_runs", "Stored runs", self.runs)
        yield CounterMetricFamily(
            "tigas_store_received_bytes", "Uploaded bytes of runs and pictures", self.received_bytes
        )
        for name, text, figure in (
            ("waiting", "Tasks waiting for the lock", "waiting"),
            ("working", "Running tasks", "working"),
            ("queue_age_seconds", "Longest wait", "age_s"),
        ):
            values = {key: getattr(queue, figure) for key, queue in self._queues.items()}
            yield labelled_gauge(f"tigas_store_{name}", text, "queue", values)
        with suppress(OSError):  # the folder was removed
            disk = os.statvfs(self._results)
            yield GaugeMetricFamily("tigas_store_free_bytes", "Free space for results", disk.f_bavail * disk.f_frsize)
