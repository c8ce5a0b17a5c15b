"""Heavy work in another process, within limits: checking a file or drawing a report takes a processor for seconds.

Python lets one thread compute at a time, so here it would stop the service. anyio keeps the worker process for the next
piece of work and ends it with the service.
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
from tigas_common.resources import give_back

NICE = 10
"""The priority of work with a limit: frames go first."""

T = TypeVar("T")
Ts = TypeVarTuple("Ts")


@dataclass(frozen=True, slots=True)
class Limit:
    """Memory and processor time that a piece of work may take in addition to the worker's present use."""

    memory: int
    """Bytes."""
    cpu_s: int
    """Of all its threads."""


class Offload(Protocol):
    """A function that does such work, in a process of its own or, in tests, in this one."""

    async def __call__(self, function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
        """Call a module's function in the worker process, and return its result or raise its error, but no OSError."""


async def offload_to_process(function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
    """Run in another process; killed there if cancelled, or if it exceeds the limit.

    Raises TooCostly if it is ended under a limit; Overloaded if the process cannot be started, or is ended
    without one.
    """
    try:
        if limit:
            return await to_process.run_sync(_within, limit, function, *arguments, cancellable=True)
        return await to_process.run_sync(function, *arguments, cancellable=True)
    except (BrokenWorkerProcess, MemoryError):
        if limit:
            raise TooCostly(
                f"It took more than {limit.memory // 1_000_000:,} MB of memory or {limit.cpu_s} s to check, "
                "or more than the machine has."
            ) from None
        raise Overloaded("The system killed the process, probably because memory is short.") from None
    except OSError as error:
        raise Overloaded(f"No process could be started: {error.strerror or error}.") from None


def _within(limit: Limit, function: Callable[[*Ts], T], *arguments: *Ts) -> T:
    os.setpriority(os.PRIO_PROCESS, 0, NICE)
    with suppress(OSError):  # on low memory the system may end other processes at its own choice
        Path("/proc/self/oom_score_adj").write_text("1000")
    try:
        with _limited(limit):
            return function(*arguments)
    except (Exception, KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # a panic in Rust code, which takes it for granted that small things can be allocated
        raise MemoryError from None
    finally:
        give_back()


@contextmanager
def _limited(limit: Limit) -> Iterator[None]:
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
