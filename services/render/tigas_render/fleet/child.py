"""One of the service's processes: started, listened to, started again when it has ended."""

from __future__ import annotations

import asyncio
import signal
import sys
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress

from tigas_common.errors import StartError
from tigas_common.processes import BackOff, how_it_ended
from tigas_render.fleet.control import Failed, Loaded, Message, Ready
from tigas_render.fleet.launched import Launched


class Child:
    """A process that is to run all the time."""

    def __init__(
        self,
        name: str,
        launch: Callable[[], Awaitable[Launched]],
        begin: Callable[[], Sequence[Message]],
        heard: Callable[[Child, Message], None],
    ) -> None:
        """name: as it is called in a sentence; launch: gives a new process; begin: what it is told when it starts, a
        `Start` first; heard: what becomes of what it says.
        """
        self.name = name
        self.ready = asyncio.Event()
        """Whether it has ever served."""
        self._launch = launch
        self._begin = begin
        self._heard = heard
        self._launched: Launched | None = None
        self._failure: str | None = None
        self._stopping = asyncio.Event()
        self._ended = asyncio.Event()

    def tell(self, message: Message) -> None:
        """Say something to it; while it does not run, what it has to know then is in its beginning."""
        if self._launched is not None:
            self._launched.channel.send(message)

    async def keep(self) -> None:
        """Run it until `end`. Raises StartError if it does not start, or ends too often."""
        back_off = BackOff()
        try:
            while not self._stopping.is_set():
                status = await self._run()
                if self._stopping.is_set():
                    return
                if not self.ready.is_set():
                    raise StartError(self._failure or f"The {self.name} did not start ({how_it_ended(status)}).")
                delay = back_off.ended(time.monotonic())
                if delay is None:
                    raise StartError(
                        f"The {self.name} has ended {BackOff.ENDS} times within {BackOff.WINDOW_S:g} s, the last time "
                        f"with {how_it_ended(status)}."
                    )
                why = f" {self._failure}" if self._failure else ""
                print(
                    f"The {self.name} has ended ({how_it_ended(status)}); it is started again.{why}",
                    file=sys.stderr,
                    flush=True,
                )
                if delay > BackOff.FIRST_S:  # the first time at once: viewers wait
                    with suppress(TimeoutError):
                        await asyncio.wait_for(self._stopping.wait(), delay)
        finally:
            self._ended.set()

    async def end(self, patience_s: float) -> None:
        """Ask it to end; kill it if it has not ended after so long."""
        self._stopping.set()
        self._signal(signal.SIGTERM)
        with suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                await self._ended.wait()
        self._signal(signal.SIGKILL)
        await self._ended.wait()

    def _signal(self, number: signal.Signals) -> None:
        if self._launched is not None:
            self._launched.signal(number)

    async def _run(self) -> int:
        """Run one process to its end; its exit status."""
        launched = self._launched = await self._launch()
        if self._stopping.is_set():
            self._signal(signal.SIGTERM)
        self._failure = None
        try:
            for message in self._begin():
                launched.channel.send(message)
            async for message in launched.channel:
                match message:
                    case Loaded():
                        continue
                    case Failed():
                        self._failure = message.detail
                        continue
                    case Ready():
                        self.ready.set()
                self._heard(self, message)
            return await launched.process.wait()
        finally:
            self._launched = None
            await launched.channel.close()
