"""The link of a run: held at its network's first state, watched while the run lasts, and fast again afterwards."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from time import time

from tigas_lab.configuration import Network
from tigas_lab.errors import RunFailed
from tigas_lab.shaper_client import LinkStatus, ShaperClient
from tigas_lab.store import LinkSample
from tigas_lab.targets import Target


@asynccontextmanager
async def held(target: Target, network: Network) -> AsyncIterator[ShaperClient | None]:
    """A network, held at its first state; afterwards the shaper's own fast link. Raises RunFailed.

    None where there is no shaper, and none is needed.
    """
    if target.shaper is None:
        if network.shaped:
            raise RunFailed(f"There is no shaper behind {target.url}, so the network must be `unshaped`.")
        yield None
        return
    shaper = ShaperClient(target.shaper, target.url)
    try:
        await (shaper.hold(network) if network.shaped else shaper.release())
        yield shaper
    finally:
        with contextlib.suppress(RunFailed):
            await shaper.release()
        await shaper.close()


@asynccontextmanager
async def watching_link(shaper: ShaperClient | None) -> AsyncIterator[list[tuple[float, LinkStatus]]]:
    """(unix ms, status) of the link, for as long as the context lasts. Raises RunFailed in the end if it was closed."""
    seen: list[tuple[float, LinkStatus]] = []
    if shaper is None:
        yield seen
        return

    async def watch() -> None:
        async for status in shaper.watch():
            seen.append((time() * 1000, status))

    task = asyncio.create_task(watch())
    try:
        yield seen
    finally:
        task.cancel()
        await asyncio.wait([task])
        # Asked for in any case: asyncio prints an exception that nobody asks for.
        error = None if task.cancelled() else task.exception()
    if error is not None:
        raise error
    if closed := next((status.closed for _, status in seen if status.closed), None):
        raise RunFailed(f"The link was closed during the run: {closed}")


def link_sample(status: LinkStatus, at: float) -> LinkSample:
    """What a run keeps of a status; `at` is in ms since the run's start."""
    return LinkSample(
        at=at,
        position_ms=status.position_ms,
        target_kbps=status.down.target_kbps,
        delivered_kbps=status.down.delivered_kbps,
        queue_ms=status.down.queue_ms,
        drops=status.down.drops,
        up_delivered_kbps=status.up.delivered_kbps,
    )
