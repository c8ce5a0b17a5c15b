"""Hands heavy work to another process: to check a large file, or to draw a report, takes a processor for seconds.

Python lets one thread compute at a time, so here it would stop the service. anyio keeps the worker process for the next
piece of work and ends it with the service.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol, TypeVar, TypeVarTuple

from anyio import BrokenWorkerProcess, to_process

from tigas_common.errors import Overloaded, TooCostly
from tigas_common.memory import give_back
from tigas_common.work_limits import Limit, limited

NICE = 10
"""The priority of work with a limit: frames go first."""

T = TypeVar("T")
Ts = TypeVarTuple("Ts")


class Offload(Protocol):
    """Where such work is done."""

    async def __call__(self, function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
        """Call a module's function in the worker process, and return its result or raise its error. It must not raise
        OSError.
        """


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
        raise Overloaded("The work was ended by the system, probably because memory is short.") from None
    except OSError as error:
        raise Overloaded(f"No process can be started for the work: {error.strerror or error}.") from None


def _within(limit: Limit, function: Callable[[*Ts], T], *arguments: *Ts) -> T:
    os.setpriority(os.PRIO_PROCESS, 0, NICE)
    with suppress(OSError):  # on low memory the system may end other processes at its own choice
        Path("/proc/self/oom_score_adj").write_text("1000")
    try:
        with limited(limit):
            return function(*arguments)
    except (Exception, KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # a panic in Rust code, which takes it for granted that small things can be allocated
        raise MemoryError from None
    finally:
        give_back()
