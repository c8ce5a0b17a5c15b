"""Retries of requests that a busy service refused, for programs that can wait."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import httpx

TRIES = 5
LATER = (409, 429, 503)
"""Superseded by a newer request; rate limited; overloaded."""
PAUSE_S, LONGEST_PAUSE_S = 1.0, 10.0
"""Default and maximum seconds between two tries."""


async def asked_again(ask: Callable[[], Awaitable[httpx.Response]]) -> httpx.Response:
    """The first answer that is not for later, or the last one. Raises as `ask` does."""
    for _ in range(TRIES - 1):
        answer = await ask()
        if answer.status_code not in LATER:
            return answer
        told = answer.headers.get("retry-after", "")
        await asyncio.sleep(min(float(told), LONGEST_PAUSE_S) if told.isdecimal() else PAUSE_S)
    return await ask()
