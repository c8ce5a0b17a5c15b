"""Resources of this process: processors within a container's quota, memory returned to the system, and capabilities."""

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
"""Configure network interfaces, filters and queues (capabilities(7))."""
CAP_SYS_ADMIN = 21
"""Create network namespaces."""
RELEASE_EVERY_S = 10.0
"""Seconds for which a service may hold on to unused memory."""
_M_ARENA_MAX = -8


def has_capabilities(*capabilities: int) -> bool:
    """Whether all of these capabilities are effective in this process."""
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines())
    effective = int(status["CapEff"], 16)
    return all(effective >> capability & 1 for capability in capabilities)


def use_one_arena() -> None:
    """Make all threads allocate from one glibc arena, as only the first arena can return memory to the system.

    Must be called before threads start.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)


def release_memory() -> None:
    """Collect garbage and return free memory (malloc_trim(3), with glibc). Takes milliseconds."""
    gc.collect()
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


async def keep_releasing_memory() -> None:
    """Return free memory periodically, in a thread, until cancelled.

    Objects from start-up are frozen, as scanning them for garbage each time would stall the service.
    """
    gc.collect()
    gc.freeze()
    while True:
        await asyncio.sleep(RELEASE_EVERY_S)
        await asyncio.to_thread(release_memory)


@dataclass(frozen=True, slots=True)
class Quota:
    """The processor time granted to one of this process's control groups (cgroups(7)), and its use so far."""

    group: Path
    processors: float
    """Number of processors that the group may keep busy."""
    used_s: float | None
    """Processor time used by everything in the group so far; None if unreadable."""
    throttled: int
    """Number of periods in which the group had to wait because its time was used up."""


def usable_processors(root: Path = Path("/")) -> int:
    """Number of processors available to this process, within its control groups' quota; at least 1."""
    return max(1, int(min((len(allowed_processors()), *(quota.processors for quota in quotas(root))))))


def allowed_processors() -> frozenset[int]:
    """Numbers of the processors available to this process."""
    return frozenset(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1))


def quotas(root: Path = Path("/")) -> Iterator[Quota]:
    """Each control group of this process that has a limit."""
    try:
        groups = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for _, controllers, path in (line.split(":", 2) for line in groups):
        if controllers and "cpu" not in controllers.split(","):
            continue
        top = root / "sys/fs/cgroup" / controllers
        for group in (own := top / path.lstrip("/"), *own.parents):  # a container may see its own group as the root
            if not group.is_relative_to(top):
                break
            with suppress(OSError, ValueError):
                quota = (_read_v1_quota if controllers else _read_v2_quota)(group)
                if quota.processors > 0:
                    yield quota


def _read_v2_quota(group: Path) -> Quota:
    """Read a cgroup v2 quota. Raises OSError, and ValueError if there is no limit (`max 100000`)."""
    limit, period = (group / "cpu.max").read_text().split()
    counted = _counters(group)
    used_us = counted.get("usage_usec")
    used_s = None if used_us is None else used_us / 1e6
    return Quota(group, int(limit) / int(period), used_s, counted.get("nr_throttled", 0))


def _read_v1_quota(group: Path) -> Quota:
    """Read a cgroup v1 quota, which is negative if there is no limit. Raises OSError and ValueError."""
    limit, period = (int((group / f"cpu.cfs_{name}_us").read_text()) for name in ("quota", "period"))
    used_s: float | None = None
    with suppress(OSError):  # cpuacct may be mounted elsewhere
        used_s = int((group / "cpuacct.usage").read_text()) / 1e9
    return Quota(group, limit / period, used_s, _counters(group).get("nr_throttled", 0))


def _counters(group: Path) -> dict[str, int]:
    try:
        lines = (group / "cpu.stat").read_text().splitlines()
    except OSError:
        return {}
    return {name: int(value) for name, value in map(str.split, lines)}
