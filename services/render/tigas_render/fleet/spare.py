"""Keeps an edge more, to take the place of one that has ended: a busy machine takes seconds to start Python."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Sequence

from tigas_render.fleet.launched import Launched

PAUSE_S = 2.0
"""The next one is started so much later than one is used: viewers come back first."""


class Spare:
    """The supervisor's side of it."""

    def __init__(self, inherited: Sequence[int]) -> None:
        """inherited: the file descriptors of all edges."""
        self._inherited = inherited
        self._own: asyncio.Task[Launched] | None = None
        """The process until it is used."""
        self._waiting: Launched | None = None
        """The same once it has nothing left to do but what it is told."""
        self._used = asyncio.Event()

    async def take(self) -> Launched:
        """An edge that is to be told how to begin: the one that waits, or one that has yet to start."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self._own = None
            self._used.set()
            if waiting.process.returncode is None:
                return waiting
            await waiting.channel.close()
        return await Launched.start("tigas_render.fleet.edge", self._inherited)

    async def keep(self) -> None:
        """Have one wait until cancelled; then `end` is to be called."""
        while True:
            self._own = asyncio.create_task(Launched.start("tigas_render.fleet.spare_edge", self._inherited))
            launched = await asyncio.shield(self._own)
            if await anext(aiter(launched.channel), None) is not None:  # it says that it is loaded
                self._used.clear()
                self._waiting = launched
                await self._used.wait()
            else:
                await launched.channel.close()
            await asyncio.sleep(PAUSE_S)

    async def end(self) -> None:
        """Kill it, since it does nothing that it could finish."""
        if self._own is not None:
            launched = await self._own
            launched.signal(signal.SIGKILL)
            await launched.process.wait()
            await launched.channel.close()
