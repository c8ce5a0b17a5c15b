"""Work that several callers share."""

from __future__ import annotations

import asyncio

import pytest

from tigas_render.single_flight import Repeated

pytestmark = pytest.mark.anyio


class Folder:
    """Is looked at when a test lets it."""

    def __init__(self) -> None:
        self.looks = 0
        self.go_on = asyncio.Semaphore(0)

    async def look(self) -> None:
        self.looks += 1
        await self.go_on.acquire()


async def test_callers_share_the_run_that_starts_after_they_asked() -> None:
    folder = Folder()
    scans = Repeated(folder.look)
    first = asyncio.create_task(scans.run())
    await asyncio.sleep(0)
    later = [asyncio.create_task(scans.run()) for _ in range(20)]
    await asyncio.sleep(0)
    folder.go_on.release()
    await first
    assert not any(task.done() for task in later), "the folder may have changed since the first look began"
    folder.go_on.release()
    await asyncio.gather(*later)
    assert folder.looks == 2


async def test_a_caller_that_leaves_takes_nothing_from_the_others() -> None:
    folder = Folder()
    scans = Repeated(folder.look)
    tasks = [asyncio.create_task(scans.run()) for _ in range(3)]
    await asyncio.sleep(0)
    tasks[0].cancel()
    folder.go_on.release()
    await asyncio.gather(*tasks[1:])
    assert folder.looks == 2
