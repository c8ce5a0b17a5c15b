"""How many processors this process may use: containers have fewer than their machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path


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
