"""How long a thread has been at work, or would have been if it had had a processor (Linux)."""

from __future__ import annotations

import time
from pathlib import Path

SCHEDSTAT = Path("/proc/thread-self/schedstat")
"""Nanoseconds on a processor, nanoseconds of waiting for one, and a count (kernel: scheduler/sched-stats)."""


def busy_time() -> float:
    """Seconds for which the calling thread has computed or waited for a processor; if that is unknown, computed.

    A loop that shares its processor with others is as busy as one that computes all the time.
    """
    try:
        on_processor, waiting, _ = SCHEDSTAT.read_bytes().split()
    except (OSError, ValueError):
        return time.thread_time()
    return (int(on_processor) + int(waiting)) / 1e9
