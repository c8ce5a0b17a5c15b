"""Heavy work in another process, within limits: checking a file or drawing a report keeps a processor busy for seconds.

Python computes in one thread at a time, so such work would stall the service. anyio keeps the worker process for
further work and ends it with the service.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar, TypeVarTuple

from anyio import BrokenWorkerProcess, to_process

from tigas_common.errors import Overloaded, TooCostly
from tigas_common.resources import release_memory

NICE = 10
"""Nice value of work with a limit, as frames take priority."""

T = TypeVar("T")
Ts = TypeVarTuple("Ts")


@dataclass(frozen=True, slots=True)
class Limit:
    """Memory and processor time that a task may take beyond the worker's current use."""

    memory: int
    """Bytes."""
    cpu_s: int
    """Seconds, of all its threads."""


class Offload(Protocol):
    """A function that runs such work in a separate process or, in tests, in this one."""

    async def __call__(self, function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
        """Call a module's function in the worker process. Returns its result or raises its error, which must not be an
        OSError.
        """


async def offload_to_process(function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
    """Run a function in another process, which is killed if cancelled or over the limit.

    Raises TooCostly if a process with a limit is killed; Overloaded if it cannot be started, or is killed without a
    limit.
    """
    try:
        if limit:
            return await to_process.run_sync(_run_limited, limit, function, *arguments, cancellable=True)
        return await to_process.run_sync(function, *arguments, cancellable=True)
    except (BrokenWorkerProcess, MemoryError):
        if limit:
            raise TooCostly(
                f"Checking it took more than {limit.memory // 1_000_000:,} MB of memory or {limit.cpu_s} s, "
                "or more than the machine has."
            ) from None
        raise Overloaded("The system killed the process, probably because memory is short.") from None
    except OSError as error:
        raise Overloaded(f"No process could be started: {error.strerror or error}.") from None


def _run_limited(limit: Limit, function: Callable[[*Ts], T], *arguments: *Ts) -> T:
    os.setpriority(os.PRIO_PROCESS, 0, NICE)
    with suppress(OSError):  # when memory is short, the system may choose other processes
        Path("/proc/self/oom_score_adj").write_text("1000")
    try:
        with _set_limit(limit):
            return function(*arguments)
    except (Exception, KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # a panic in Rust code, which expects small allocations to succeed
        raise MemoryError from None
    finally:
        release_memory()


@contextmanager
def _set_limit(limit: Limit) -> Iterator[None]:
    """Have the system end this process if it exceeds the limit. Only Linux enforces the memory limit."""
    if sys.platform != "linux":
        yield
        return
    import resource

    # On running out of memory, Rust code would print a backtrace, which needs memory, and then deadlock.
    os.environ["RUST_BACKTRACE"] = "0"
    # RLIMIT_DATA limits written memory, not addresses: libraries reserve gigabytes of these for their threads.
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
    """Private writable memory of the process in bytes, as counted by RLIMIT_DATA."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(next(line for line in status.splitlines() if line.startswith("VmData:")).split()[1])
