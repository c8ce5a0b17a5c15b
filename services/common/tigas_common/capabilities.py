"""Network capabilities of this process (capabilities(7))."""

from __future__ import annotations

from pathlib import Path

CAP_NET_ADMIN = 12
"""Configure interfaces, filters and queues."""
CAP_SYS_ADMIN = 21
"""Make network namespaces."""
CAP_SYS_NICE = 23
"""Go before other processes."""


def holds(*capabilities: int) -> bool:
    """Whether this process has all of these capabilities in effect."""
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines())
    effective = int(status["CapEff"], 16)
    return all(effective >> capability & 1 for capability in capabilities)
