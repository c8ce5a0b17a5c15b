"""Hands heavy work to another process: to check a long run, or to draw a report, takes a processor for seconds.

Python lets one thread compute at a time, so here it would stop the service. anyio keeps the worker process for the next
piece of work and ends it with the service.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar, TypeVarTuple

from anyio import BrokenWorkerProcess, to_process

from tigas_common.errors import Overloaded

T = TypeVar("T")
Ts = TypeVarTuple("Ts")


class Offload(Protocol):
    """Where such work is done."""

    async def __call__(self, function: Callable[[*Ts], T], *arguments: *Ts) -> T:
        """Call a module's function there, and return or raise what it does. It must not raise OSError."""


async def offload_to_process(function: Callable[[*Ts], T], *arguments: *Ts) -> T:
    """Done in another process; killed there if nobody waits for it any longer.

    Raises Overloaded if the process cannot be started, or is ended by the system.
    """
    try:
        return await to_process.run_sync(function, *arguments, cancellable=True)
    except BrokenWorkerProcess:
        raise Overloaded("The work was ended by the system, probably for want of memory.") from None
    except OSError as error:
        raise Overloaded(f"No process can be started for the work: {error.strerror or error}.") from None
