"""Gives memory that is not needed any more back to the system: Python and glibc would keep most of it for ever."""

from __future__ import annotations

import asyncio
import ctypes
import gc
from contextlib import suppress

EVERY_S = 10.0
"""How long a service may keep what it does not need, in seconds."""


_M_ARENA_MAX = -8


def keep_together() -> None:
    """Let all threads allocate from one arena of glibc's: it can only give back what lies in the first one.

    To be called before there are threads.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 1)


def give_back() -> None:
    """Collect garbage and return what is free (malloc_trim(3), where the C library is glibc). Takes milliseconds."""
    gc.collect()
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


async def give_back_regularly() -> None:
    """Give memory back again and again, in a thread, until this is cancelled.

    What start-up made stays: to look through it for garbage each time would hold up whatever the service does.
    """
    gc.collect()
    gc.freeze()
    while True:
        await asyncio.sleep(EVERY_S)
        await asyncio.to_thread(give_back)
