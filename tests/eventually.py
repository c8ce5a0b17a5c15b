"""Waits for conditions that no event announces."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from inspect import iscoroutine

LIMIT_S = 30


async def eventually(condition: Callable[[], object]) -> None:
    """Wait until a condition, which may be a coroutine function, holds; other tasks run meanwhile."""
    async with asyncio.timeout(LIMIT_S):
        while True:
            result = condition()
            if await result if iscoroutine(result) else result:
                return
            await asyncio.sleep(0.002)


def wait_until(condition: Callable[[], object], limit_s: float = LIMIT_S) -> None:
    """The same without an event loop: an AssertionError if the condition does not hold in time."""
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, f"{condition} was not true after {limit_s} s"
        time.sleep(0.02)
