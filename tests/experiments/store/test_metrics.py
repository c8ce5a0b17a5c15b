"""Waiting clients are visible exactly while they wait."""

from __future__ import annotations

import asyncio

import pytest

from tigas_experiments.store.metrics import MonitoredLock

pytestmark = pytest.mark.anyio


async def test_one_at_a_time_and_the_rest_are_seen_to_wait() -> None:
    now = 100.0
    turns = MonitoredLock(lambda: now)

    async def work() -> None:
        async with turns:
            await asyncio.Event().wait()

    assert (turns.waiting, turns.working, turns.age_s) == (0, False, 0.0)
    async with turns:
        first = asyncio.create_task(work())
        await asyncio.sleep(0)
        now = 103.0
        second = asyncio.create_task(work())
        await asyncio.sleep(0)
        now = 105.0
        assert (turns.waiting, turns.working, turns.age_s) == (2, True, 5.0)
        first.cancel()  # its viewer has left
        await asyncio.gather(first, return_exceptions=True)
        assert (turns.waiting, turns.age_s) == (1, 2.0)
    await asyncio.sleep(0)
    assert (turns.waiting, turns.working, turns.age_s) == (0, True, 0.0)
    second.cancel()
    await asyncio.gather(second, return_exceptions=True)
    assert not turns.working
