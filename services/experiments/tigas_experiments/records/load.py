"""Load of the machine and the render service during a run: if high, latencies reflect it rather than the network."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import httpx
import psutil

from tigas_common.resources import Quota, allowed_processors, quotas
from tigas_common.wire.model import WireModel
from tigas_common.wire.render import HostLoad

SAMPLE_EVERY_S = 0.5
"""Interval between samples, in seconds."""
SATURATION_LIMIT = 0.9
"""Busy share above which work has to wait for a processor or a thread."""
MAX_PEGGED_SHARE = 0.1
"""Share of a run's samples above which exceeding the limit is reported."""
WatchedServices = Literal["threads", "processors", "elsewhere"]
"""What is monitored: each of the services' threads; only the processors, which they share with the browser; or nothing,
as some services ran on another machine.
"""
Processes = Mapping[psutil.Process, str]
"""Processes with monitored threads, and their names."""


class LoadSample(WireModel):
    """One moment, or the interval since the previous sample."""

    unix_ms: float
    cpu: float
    """Busy share, 0 to 1, of the processors available to the run, or used share of the time granted by a control group,
    whichever is greater. In early runs: of all processors of the machine.
    """
    processors: float | None = None
    """Number of processors available to the run; unknown for early runs."""
    throttled: bool = False
    """Whether a control group had to wait because its time was used up."""
    threads: dict[str, float] | None = None
    """Share of time, 0 to 1, for which each process's busiest thread ran or was ready to run, by process name; None if
    not monitored.
    """
    render: float | None = None
    """Utilisation, 0 to 1, of the busiest part of the render service, such as its GPU; None if unknown."""
    load_average: float
    """Average number of running or runnable processes over the last minute."""

    @property
    def saturated(self) -> bool:
        return self.cpu > SATURATION_LIMIT or self.throttled or (self.render or 0.0) > SATURATION_LIMIT


class Load(WireModel):
    cpu_mean: float
    cpu_max: float
    saturated_share: float
    """Share of samples in which the processors (95 % in early runs) or the render service were above LIMIT, or a
    control group had to wait.
    """
    load_average_max: float
    processors: float | None
    """Number of processors available to the run; for early runs, of the machine."""
    pegged: dict[str, float] | None = None
    """Share of samples with a thread above LIMIT, by process name; None if not monitored."""
    render_busy_share: float | None = None
    """Share of samples with the render service above LIMIT, on any machine; None if unknown."""
    services: WatchedServices | None = None
    """None for runs made on a page, and for early runs."""

    @property
    def saturated(self) -> bool:
        return self.saturated_share > MAX_PEGGED_SHARE

    @property
    def often_pegged(self) -> dict[str, float]:
        """Entries of `pegged` above MAX_PEGGED_SHARE, highest first."""
        often = [each for each in (self.pegged or {}).items() if each[1] > MAX_PEGGED_SHARE]
        return dict(sorted(often, key=lambda each: -each[1]))

    @property
    def worst_pegged(self) -> tuple[str, float] | None:
        """The highest entry of `pegged`; None if it is empty."""
        return max((self.pegged or {}).items(), key=lambda each: each[1], default=None)

    @classmethod
    def summarise(cls, samples: Sequence[LoadSample], services: WatchedServices | None = None) -> Load | None:
        """Summarise samples; None without any."""
        if not samples:
            return None
        watched = [sample.threads for sample in samples if sample.threads is not None]
        pegged = [name for threads in watched for name, share in threads.items() if share > SATURATION_LIMIT]
        render = [sample.render for sample in samples if sample.render is not None]
        return cls(
            cpu_mean=sum(sample.cpu for sample in samples) / len(samples),
            cpu_max=max(sample.cpu for sample in samples),
            saturated_share=sum(sample.saturated for sample in samples) / len(samples),
            load_average_max=max(sample.load_average for sample in samples),
            processors=samples[-1].processors,
            pegged={name: pegged.count(name) / len(watched) for name in sorted(set(pegged))} if watched else None,
            render_busy_share=sum(share > SATURATION_LIMIT for share in render) / len(render) if render else None,
            services=services,
        )


class Thread(NamedTuple):
    """A thread of a process, and the seconds that it has run or waited in a run queue so far."""

    process: str
    demand_s: float


@dataclass(frozen=True, slots=True)
class Reading:
    """The machine's counters at one moment."""

    at_s: float
    """Time on a monotonic clock."""
    busy_s: float
    """Total busy time of the processors that this process may use."""
    idle_s: float
    processors: int
    quotas: tuple[Quota, ...] = ()
    threads: Mapping[tuple[int, int], Thread] | None = None
    """Threads by process id and thread id; None if not monitored."""

    @classmethod
    def take(cls, processes: Processes | None) -> Reading:
        """The current counters; takes some milliseconds for hundreds of threads."""
        at_s = time.monotonic()
        every, allowed = psutil.cpu_times(percpu=True), allowed_processors()
        ours = [times for number, times in enumerate(every) if number in allowed] or every
        idle_s = sum(times.idle + getattr(times, "iowait", 0.0) for times in ours)
        # `user` and `nice` already include guest time.
        guests_s = sum(getattr(times, "guest", 0.0) + getattr(times, "guest_nice", 0.0) for times in ours)
        threads: dict[tuple[int, int], Thread] = {}
        for process, name in (processes or {}).items():
            with suppress(psutil.Error):  # it has ended, or belongs to another user
                for thread in process.threads():
                    used_s = thread.user_time + thread.system_time
                    threads[process.pid, thread.id] = Thread(name, _demand(process.pid, thread.id) or used_s)
        return cls(
            at_s=at_s,
            busy_s=sum(map(sum, ours)) - guests_s - idle_s,
            idle_s=idle_s,
            processors=len(ours),
            quotas=tuple(quotas()),
            threads=None if processes is None else threads,
        )

    def sample_since(
        self, before: Reading, unix_ms: float, load_average: float, render: float | None = None
    ) -> LoadSample:
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
        busiest: dict[str, float] = {}
        for key, thread in (self.threads or {}).items():
            known = (before.threads or {}).get(key, thread)  # a new thread cannot have been busy for long
            share = round(_share(thread.demand_s - known.demand_s, elapsed_s), 3)
            busiest[thread.process] = max(share, busiest.get(thread.process, 0.0))
        return LoadSample(
            unix_ms=unix_ms,
            cpu=max(shares),
            processors=min((self.processors, *(quota.processors for quota in self.quotas))),
            throttled=throttled,
            threads=None if self.threads is None or before.threads is None else busiest,
            render=render,
            load_average=load_average,
        )


@asynccontextmanager
async def monitor_load(
    render: str, keep: int | None = None, processes: Processes | None = None
) -> AsyncIterator[deque[LoadSample]]:
    """Sample the load every SAMPLE_EVERY_S seconds during the context, keeping the newest `keep` samples.

    render: URL of the render service.
    """
    samples: deque[LoadSample] = deque(maxlen=keep)

    async def watch() -> None:
        async with httpx.AsyncClient(base_url=render, timeout=SAMPLE_EVERY_S, trust_env=False, verify=False) as client:
            before = await asyncio.to_thread(Reading.take, processes)
            while True:
                await asyncio.sleep(SAMPLE_EVERY_S)
                share = await _utilisation(client)
                now = await asyncio.to_thread(Reading.take, processes)
                samples.append(now.sample_since(before, time.time() * 1000, psutil.getloadavg()[0], share))
                before = now

    task = asyncio.create_task(watch())
    try:
        yield samples
    finally:
        task.cancel()


async def _utilisation(client: httpx.AsyncClient) -> float | None:
    """Utilisation of the render service; None if it is not reported, as in a cluster."""
    try:
        answer = (await client.get("/api/load")).raise_for_status()
        return HostLoad.model_validate_json(answer.content).utilisation
    except (httpx.HTTPError, ValueError):
        return None


def _share(part: float, whole: float) -> float:
    return min(1.0, max(0.0, part / whole)) if whole > 0 else 0.0


def _demand(process: int, thread: int) -> float | None:
    """Seconds for which a thread ran or was ready to run, from Linux's `schedstat`; None where unavailable."""
    try:
        ran, waited, _ = Path(f"/proc/{process}/task/{thread}/schedstat").read_text(encoding="ascii").split()
    except (OSError, ValueError):
        return None
    return (int(ran) + int(waited)) / 1e9
