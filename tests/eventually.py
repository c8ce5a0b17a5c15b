"""Waits for conditions that no event announces."""

from __future__ import annotations

import asyncio
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
