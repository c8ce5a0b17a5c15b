"""The link of a run: held at its network's first state, watched while the run lasts, and fast again afterwards."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from time import time

from tigas_common.wire.shaper import ShaperStatus
from tigas_experiments.errors import RunFailed
from tigas_experiments.run.shaper_client import ShaperClient
from tigas_experiments.run.targets import Target
from tigas_experiments.wire.recording import LinkSample
from tigas_experiments.wire.run import Network

JUMP_MS = 500
"""A trace so far from where time has brought it was moved; less may pass between the shaper's looks at its clock."""


@dataclass(frozen=True, slots=True)
class HeldLink:
    """A link reserved for a run."""

    shaper: ShaperClient
    network: Network
    first: ShaperStatus
    """How it was when it was first held."""

    async def play(self) -> None:
        """Play the network's trace, if it is one, from where a run begins. Raises RunFailed."""
        if self.network.trace is not None:
            await self.shaper.play(self.network)

    def left_alone(self, seen: Iterable[ShaperStatus]) -> bool:
        """Whether the link only changed according to its network; `seen` begins before the trace was played."""
        playing: ShaperStatus | None = None
        for status in seen:
            if status.trace != self.first.trace:
                return False
            if self.network.trace is None:
                if status.link != self.first.link:
                    return False
                continue
            if self.network.rtt_ms is not None and status.link.delay_ms != self.first.link.delay_ms:
                return False
            if playing is None and status.mode == "paused":
                continue
            playing = playing or status
            if status.mode != "playing" or _jump_ms(playing, status) > JUMP_MS:
                return False
        return True


@asynccontextmanager
async def held(target: Target, network: Network) -> AsyncIterator[HeldLink | None]:
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
        yield HeldLink(shaper, network, await (shaper.hold(network) if network.shaped else shaper.release()))
    finally:
        with contextlib.suppress(RunFailed):
            await shaper.release()
        await shaper.close()


@asynccontextmanager
async def watching_link(link: HeldLink | None) -> AsyncIterator[list[tuple[float, ShaperStatus]]]:
    """Record (unix ms, status) of the link during the context.

    Raises RunFailed at the end if the link was closed or changed from outside.
    """
    seen: list[tuple[float, ShaperStatus]] = []
    if link is None:
        yield seen
        return

    async def watch() -> None:
        async for status in link.shaper.watch():
            seen.append((time() * 1000, status))

    task = asyncio.create_task(watch())
    try:
        yield seen
    finally:
        task.cancel()
        await asyncio.wait([task])
        # Always retrieved, because asyncio logs unretrieved exceptions.
        error = None if task.cancelled() else task.exception()
    if error is not None:
        raise error
    if closed := next((status.closed for _, status in seen if status.closed), None):
        raise RunFailed(f"The link was closed during the run: {closed}")
    if not link.left_alone(status for _, status in seen):
        raise RunFailed("The link was changed from outside during the run.")


def link_sample(status: ShaperStatus, at: float) -> LinkSample:
    """The recorded part of a status; `at` is in ms since the run's start."""
    return LinkSample(
        at=at,
        position_ms=status.position_ms,
        target_kbps=status.down.target_kbps,
        delivered_kbps=status.down.delivered_kbps,
        queue_ms=status.down.queue_ms,
        drops=status.down.drops,
        up_delivered_kbps=status.up.delivered_kbps,
    )


def _jump_ms(earlier: ShaperStatus, later: ShaperStatus) -> float:
    """How far a trace is from where time alone would have brought it; at its end it starts again."""
    if earlier.position_ms is None or later.position_ms is None or not later.duration_ms:
        return 0.0
    half = later.duration_ms / 2
    moved = later.position_ms - earlier.position_ms - (later.time_ms - earlier.time_ms)
    return abs((moved + half) % later.duration_ms - half)
