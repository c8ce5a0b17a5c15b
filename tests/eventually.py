"""Waits for conditions that no event announces."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

LIMIT_S = 20


async def eventually(condition: Callable[[], object]) -> None:
    """Wait until a condition holds; other tasks run meanwhile."""
    async with asyncio.timeout(LIMIT_S):
        while not condition():  # noqa: ASYNC110 - it has no event
            await asyncio.sleep(0.002)
