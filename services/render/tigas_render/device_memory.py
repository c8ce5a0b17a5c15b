"""What to do when the device's memory is full."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeVar

from tigas_common.errors import OutOfDeviceMemory

Result = TypeVar("Result")


async def with_room(attempt: Callable[[], Awaitable[Result]], evict: Callable[[], bool]) -> Result:
    """The result of `attempt`; if the device's memory is full, of a second one after `evict` has unloaded something.

    Raises what the last attempt raises; OutOfDeviceMemory also if `evict` finds nothing to unload and gives False.
    """
    try:
        return await attempt()
    except OutOfDeviceMemory:
        if not evict():
            raise
    return await attempt()  # not before the error is gone, which holds what was allocated until then
