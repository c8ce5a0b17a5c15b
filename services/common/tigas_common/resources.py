"""Resources of this process: processors within a container's quota, memory returned to the system, capabilities."""

from __future__ import annotations

import asyncio
import ctypes
import gc
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

CAP_NET_ADMIN = 12
"""Configure interfaces, filters and queues (capabilities(7))."""
CAP_SYS_ADMIN = 21
"""Make network namespaces."""
GIVE_BACK_EVERY_S = 10.0
"""Seconds for which a service may keep unused memory."""
_M_ARENA_MAX = -8


def has_capabilities(*capabilities: int) -> bool:
    """Whether this process has all of these capabilities in effect."""
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines())
    effective = int(status["CapEff"], 16)
    return all(effective >> capability & 1 for capability in capabilities)


def keep_together() -> None:
    """Make all threads allocate from one glibc arena: only the first one can return memory to the system.

    Must be called before threads start.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)


def give_back() -> None:
    """Collect garbage and return free memory (malloc_trim(3), with glibc). Takes milliseconds."""
    gc.collect()
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


async def give_back_regularly() -> None:
    """Return memory periodically, in a thread, until cancelled.

    Objects from start-up are frozen: scanning them for garbage each time would stall the service.
    """
    gc.collect()
    gc.freeze()
    while True:
        await asyncio.sleep(GIVE_BACK_EVERY_S)
        await asyncio.to_thread(give_back)


@dataclass(frozen=True, slots=True)
class Quota:
    """The processor time that a control group about this process is given (cgroups(7)), and how much it has used."""

    group: Path
    processors: float
    """How many it may keep busy."""
    used_s: float | None
    """Processor time of all that is in it so far; None if that cannot be read."""
    throttled: int
    """Periods so far in which it had to wait, as its time was used up."""


def usable_processors(root: Path = Path("/")) -> int:
    """Number of processors available to this process, within its control groups' quota; at least 1."""
    return max(1, int(min((len(allowed_processors()), *(quota.processors for quota in quotas(root))))))


def allowed_processors() -> frozenset[int]:
    """Numbers of the processors available to this process."""
    return frozenset(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1))


def quotas(root: Path = Path("/")) -> Iterator[Quota]:
    """Each control group about this process that has a limit."""
    try:
        groups = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for _, controllers, path in (line.split(":", 2) for line in groups):
        if controllers and "cpu" not in controllers.split(","):
            continue
        top = root / "sys/fs/cgroup" / controllers
        for group in (own := top / path.lstrip("/"), *own.parents):  # a container may see its own group as the top
            if not group.is_relative_to(top):
                break
            with suppress(OSError, ValueError):
                quota = (_version_1 if controllers else _version_2)(group)
                if quota.processors > 0:
                    yield quota


def _version_2(group: Path) -> Quota:
    """Raises OSError, and ValueError without a limit: `max 100000`."""
    limit, period = (group / "cpu.max").read_text().split()
    counted = _counters(group)
    used_us = counted.get("usage_usec")
    used_s = None if used_us is None else used_us / 1e6
    return Quota(group, int(limit) / int(period), used_s, counted.get("nr_throttled", 0))


def _version_1(group: Path) -> Quota:
    """The same; without a limit it is negative."""
    limit, period = (int((group / f"cpu.cfs_{name}_us").read_text()) for name in ("quota", "period"))
    used_s: float | None = None
    with suppress(OSError):  # unless cpuacct is mounted elsewhere
        used_s = int((group / "cpuacct.usage").read_text()) / 1e9
    return Quota(group, limit / period, used_s, _counters(group).get("nr_throttled", 0))


def _counters(group: Path) -> dict[str, int]:
    try:
        lines = (group / "cpu.stat").read_text().splitlines()
    except OSError:
        return {}
    return {name: int(value) for name, value in map(str.split, lines)}
