"""Retry when the device's memory is full."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeVar

from tigas_common.errors import OutOfDeviceMemory

Result = TypeVar("Result")


async def with_room(attempt: Callable[[], Awaitable[Result]], evict: Callable[[], bool]) -> Result:
    """The result of `attempt`; if the device's memory is full, of a second attempt after `evict` has unloaded a scene.

    Raises the last attempt's error; OutOfDeviceMemory also if `evict` finds nothing to unload and returns False.
    """
    try:
        return await attempt()
    except OutOfDeviceMemory:
        if not evict():
            raise
    return await attempt()  # only after the error is released, which references the allocations
