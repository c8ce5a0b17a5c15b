"""Readings of how busy the machine is, and a watch that takes them all the time."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass

import psutil

from tigas_common.resources import Quota, allowed_processors, quotas
from tigas_experiments.records.load import LoadSample

EVERY_S = 0.5
Processes = Mapping[psutil.Process, str]
"""Processes with monitored threads, and their names."""


@dataclass(frozen=True, slots=True)
class Thread:
    """One thread of a process."""

    process: str
    """Its name."""
    used_s: float
    """Processor time so far."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Counters at one moment."""

    at_s: float
    """Time of a monotonic clock."""
    busy_s: float
    """Total busy time of the processors that this process may use."""
    idle_s: float
    processors: int
    """How many that are."""
    quotas: tuple[Quota, ...] = ()
    threads: Mapping[tuple[int, int], Thread] | None = None
    """Threads by process and thread id; None if not monitored."""

    def sample_since(self, before: Reading, unix_ms: float, load_average: float) -> LoadSample:
        """The load between two readings."""
        elapsed_s = self.at_s - before.at_s
        busy_s = self.busy_s - before.busy_s
        shares = [_share(busy_s, busy_s + self.idle_s - before.idle_s)]
        throttled = False
        earlier = {quota.group: quota for quota in before.quotas}
        for now in self.quotas:
            then = earlier.get(now.group, now)
            throttled = throttled or now.throttled > then.throttled
            if now.used_s is not None and then.used_s is not None:
                shares.append(_share(now.used_s - then.used_s, now.processors * elapsed_s))
        return LoadSample(
            unix_ms=unix_ms,
            cpu=max(shares),
            processors=min((self.processors, *(quota.processors for quota in self.quotas))),
            throttled=throttled,
            threads=self._busiest_since(before, elapsed_s),
            load_average=load_average,
        )

    def _busiest_since(self, before: Reading, elapsed_s: float) -> dict[str, float] | None:
        if self.threads is None or before.threads is None:
            return None
        busiest: dict[str, float] = {}
        for key, thread in self.threads.items():
            then = before.threads.get(key, thread)  # a new one has not been busy for long
            share = round(_share(thread.used_s - then.used_s, elapsed_s), 3)
            busiest[thread.process] = max(share, busiest.get(thread.process, 0.0))
        return busiest


def read(processes: Processes | None) -> Reading:
    """The machine's current counters; takes some milliseconds for hundreds of threads."""
    at_s = time.monotonic()
    every, allowed = psutil.cpu_times(percpu=True), allowed_processors()
    ours = [times for number, times in enumerate(every) if number in allowed] or every
    idle_s = sum(times.idle + getattr(times, "iowait", 0.0) for times in ours)
    # Guest time is already included in `user` and `nice`.
    guests_s = sum(getattr(times, "guest", 0.0) + getattr(times, "guest_nice", 0.0) for times in ours)
    return Reading(
        at_s=at_s,
        busy_s=sum(map(sum, ours)) - guests_s - idle_s,
        idle_s=idle_s,
        processors=len(ours),
        quotas=tuple(quotas()),
        threads=None if processes is None else _threads(processes),
    )


@asynccontextmanager
async def watching_load(
    keep: int | None = None, processes: Processes | None = None
) -> AsyncIterator[deque[LoadSample]]:
    """Sample the load every EVERY_S during the context; keeps the newest `keep` samples."""
    samples: deque[LoadSample] = deque(maxlen=keep)

    async def watch() -> None:
        before = await asyncio.to_thread(read, processes)
        while True:
            await asyncio.sleep(EVERY_S)
            now = await asyncio.to_thread(read, processes)
            samples.append(now.sample_since(before, time.time() * 1000, psutil.getloadavg()[0]))
            before = now

    task = asyncio.create_task(watch())
    try:
        yield samples
    finally:
        task.cancel()


def _threads(processes: Processes) -> dict[tuple[int, int], Thread]:
    found: dict[tuple[int, int], Thread] = {}
    for process, name in processes.items():
        with suppress(psutil.Error):  # it has ended, or is another user's
            for thread in process.threads():
                found[process.pid, thread.id] = Thread(name, thread.user_time + thread.system_time)
    return found


def _share(part: float, whole: float) -> float:
    return min(1.0, max(0.0, part / whole)) if whole > 0 else 0.0
