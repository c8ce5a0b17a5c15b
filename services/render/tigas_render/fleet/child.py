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

RARE_S, RAREST_S = 15.0, 900.0
"""What keeps ending is started again after so long, while others do its work; then after twice as long, up to this."""


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
        self.settled = asyncio.Event()
        """Whether it has come as far as it gets for now: it serves, or has ended."""
        self.others: Sequence[Child] = ()
        """Those that do its work while it cannot."""
        self._launch = launch
        self._begin = begin
        self._heard = heard
        self._launched: Launched | None = None
        self._served_since: float | None = None
        self._failure: str | None = None
        self._stopping = asyncio.Event()
        self._ended = asyncio.Event()

    def tell(self, message: Message) -> None:
        """Say something to it; while it does not run, what it has to know then is in its beginning."""
        if self._launched is not None:
            self._launched.channel.send(message)

    async def keep(self) -> None:
        """Run it until `end`. Raises StartError if it does not start, or ends too often, and no other does its work."""
        back_off = BackOff()
        rare_s: float | None = None
        try:
            while not self._stopping.is_set():
                status = await self._run()
                if self._stopping.is_set():
                    return
                delay = back_off.ended(time.monotonic())
                if self._served_s() > BackOff.WINDOW_S:
                    rare_s = None
                if rare_s is None and self.ready.is_set() and delay is not None:
                    why = f" {self._failure}" if self._failure else ""
                    _say(f"The {self.name} has ended ({how_it_ended(status)}); it is started again.{why}")
                    if delay == BackOff.FIRST_S:  # the first time at once: viewers wait
                        delay = 0.0
                elif await self._are_others_up():
                    delay = rare_s = RARE_S if rare_s is None else min(2 * rare_s, RAREST_S)
                    _say(f"{self._why(status)} It is tried again in {delay:g} s; others do its work meanwhile.")
                else:
                    raise StartError(self._why(status))
                if delay:
                    with suppress(TimeoutError):
                        await asyncio.wait_for(self._stopping.wait(), delay)
        finally:
            self._ended.set()
            self.settled.set()

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
        self._served_since = None
        self.settled.clear()
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
                        self._served_since = time.monotonic()
                        self.ready.set()
                        self.settled.set()
                self._heard(self, message)
            return await launched.process.wait()
        finally:
            self._launched = None
            self.settled.set()
            await launched.channel.close()

    @property
    def _serves(self) -> bool:
        return self._launched is not None and self._served_since is not None

    def _served_s(self) -> float:
        """How long it has served, or did before it ended."""
        return 0.0 if self._served_since is None else time.monotonic() - self._served_since

    async def _are_others_up(self) -> bool:
        """Whether another does this one's work; of those that are starting that is not known before they have."""
        while not any(other._serves for other in self.others):
            starting = [other for other in self.others if not other.settled.is_set()]
            if not starting:
                return False
            await starting[0].settled.wait()
        return True

    def _why(self, status: int) -> str:
        """Why it is not simply started again."""
        if not self.ready.is_set():
            if self._failure is None:
                return f"The {self.name} did not start ({how_it_ended(status)})."
            return f"The {self.name} did not start: {self._failure}" if self.others else self._failure
        said = f" {self._failure}" if self._failure else ""
        return (
            f"The {self.name} has ended {BackOff.ENDS} times within {BackOff.WINDOW_S:g} s, the last time with "
            f"{how_it_ended(status)}.{said}"
        )


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
