"""The store's figures for Prometheus: what came in, what waits for its turn, and how much room is left."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_experiments.store.turns import Turns


class StoreMetrics(Collector):
    """Of one store."""

    def __init__(self, results: Path, queues: Mapping[str, Turns]) -> None:
        """queues: the work that is done in turn, by its name."""
        self._results = results
        self._queues = queues
        self.runs = 0
        """Runs that were kept."""
        self.received_bytes = 0
        """Of runs and pictures, also those that were refused."""

    def collect(self) -> Iterator[Metric]:
        """As it is now."""
        yield CounterMetricFamily("tigas_store_runs", "Runs that were kept", self.runs)
        yield CounterMetricFamily("tigas_store_received_bytes", "Bytes of runs and pictures", self.received_bytes)
        waiting = GaugeMetricFamily("tigas_store_waiting", "Pieces of work that wait for their turn", labels=["queue"])
        working = GaugeMetricFamily("tigas_store_working", "Pieces of work that are done now", labels=["queue"])
        ages = GaugeMetricFamily("tigas_store_queue_age_seconds", "The longest wait", labels=["queue"])
        for name, queue in self._queues.items():
            waiting.add_metric([name], queue.waiting)
            working.add_metric([name], queue.working)
            ages.add_metric([name], queue.age_s)
        yield from (waiting, working, ages)
        with suppress(OSError):  # the folder is gone: there is nothing to tell
            disk = os.statvfs(self._results)
            yield GaugeMetricFamily("tigas_store_free_bytes", "Room for results", disk.f_bavail * disk.f_frsize)
