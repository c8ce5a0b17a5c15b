"""A standby edge, which replaces one that has ended: starting Python takes seconds on a busy machine."""

from __future__ import annotations

import asyncio
import logging
import signal
from collections.abc import Sequence
from contextlib import suppress

from tigas_render.workers.worker import WorkerProcess

logger = logging.getLogger(__name__)

PAUSE_S = 2.0
"""Seconds between the use of a standby and the start of the next one: returning viewers come first."""


class Standby:
    """The supervisor's side of it."""

    def __init__(self, inherited: Sequence[int]) -> None:
        """inherited: the file descriptors of all edges."""
        self._inherited = inherited
        self._own: asyncio.Task[WorkerProcess] | None = None
        """The process until it is used."""
        self._waiting: WorkerProcess | None = None
        """The same once it is loaded, and waits for its first message."""
        self._used = asyncio.Event()

    async def take(self) -> WorkerProcess:
        """Return a process for an edge: the waiting one, or a new one."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self._own = None
            self._used.set()
            if waiting.process.returncode is None:
                return waiting
            await waiting.channel.close()
        return await WorkerProcess.start("edge", self._inherited)

    async def keep(self) -> None:
        """Keep one waiting until cancelled. Then call `end`."""
        while True:
            self._own = asyncio.create_task(WorkerProcess.start("standby_edge", self._inherited))
            try:
                launched = await asyncio.shield(self._own)
            except OSError as error:  # such as a fork for which there was no memory
                self._own = None
                logger.warning("No spare edge could be started: %s", error)
                await asyncio.sleep(PAUSE_S)
                continue
            if await anext(aiter(launched.channel), None) is not None:  # its `Loaded`
                self._used.clear()
                self._waiting = launched
                await self._used.wait()
            else:
                await launched.channel.close()
            await asyncio.sleep(PAUSE_S)

    async def end(self) -> None:
        """Kill it, since it has no work to finish."""
        if self._own is None:
            return
        with suppress(OSError):  # it was about to start, and could not
            launched = await self._own
            launched.signal(signal.SIGKILL)
            await launched.process.wait()
            await launched.channel.close()
