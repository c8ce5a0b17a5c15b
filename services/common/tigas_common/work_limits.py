"""How much memory and processor time a piece of work may take of the process that does it, so that it takes no more."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Limit:
    """In addition to the process' present use."""

    memory: int
    """Bytes."""
    cpu_s: int
    """Of all its threads."""


@contextmanager
def limited(limit: Limit) -> Iterator[None]:
    """Have the system end this process if it takes more meanwhile. Only Linux holds a process to its memory."""
    if sys.platform != "linux":
        yield
        return
    import resource

    # Rust code would print where it was when memory ran out, which takes memory, and then waits for itself for ever.
    os.environ["RUST_BACKTRACE"] = "0"
    # Limits written memory, not addresses: libraries reserve gigabytes of these for their threads.
    kinds = {
        resource.RLIMIT_DATA: _data_bytes() + limit.memory,
        resource.RLIMIT_CPU: int(time.process_time()) + 1 + limit.cpu_s,
    }
    before = {kind: resource.getrlimit(kind) for kind in kinds}
    try:
        for kind, most in kinds.items():
            soft, hard = before[kind]
            others = [each for each in (soft, hard) if each != resource.RLIM_INFINITY]
            resource.setrlimit(kind, (min(most, *others) if others else most, hard))
        yield
    finally:
        for kind, old in before.items():
            resource.setrlimit(kind, old)


def _data_bytes() -> int:
    """Private writable memory of the process, as counted by RLIMIT_DATA."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(next(line for line in status.splitlines() if line.startswith("VmData:")).split()[1])
