"""How many processors this process may use: containers have fewer than their machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path


def usable_processors(root: Path = Path("/")) -> int:
    """Those that it may run on, and no more than its control groups have time for (cgroups(7)); at least 1."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, int(min((allowed, *_quotas(root)))))


def _quotas(root: Path) -> Iterator[float]:
    """The processors that each control group about this process may keep busy, where it has a limit."""
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
                quota, period = (_version_1 if controllers else _version_2)(group)
                if quota > 0:
                    yield quota / period


def _version_2(group: Path) -> tuple[int, int]:
    """Microseconds of processor time, and in how many. Raises ValueError without a limit: `max 100000`."""
    quota, period = (group / "cpu.max").read_text().split()
    return int(quota), int(period)


def _version_1(group: Path) -> tuple[int, int]:
    """The same; without a limit the first is -1."""
    return int((group / "cpu.cfs_quota_us").read_text()), int((group / "cpu.cfs_period_us").read_text())
