"""Gives memory that is not needed any more back to the system: Python and glibc would keep most of it for ever."""

from __future__ import annotations

import asyncio
import ctypes
import gc
from contextlib import suppress

EVERY_S = 10.0
"""Seconds for which a service may keep unused memory."""


_M_ARENA_MAX = -8


def keep_together() -> None:
    """Make all threads allocate from one glibc arena: only the first one can return memory to the system.

    Must be called before threads start.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)


def give_back() -> None:
    """Collect garbage and return free memory (malloc_trim(3), with glibc). Takes milliseconds."""
    gc.collect()
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


async def give_back_regularly() -> None:
    """Return memory periodically, in a thread, until cancelled.

    Objects from start-up are frozen: scanning them for garbage each time would stall the service.
    """
    gc.collect()
    gc.freeze()
    while True:
        await asyncio.sleep(EVERY_S)
        await asyncio.to_thread(give_back)
