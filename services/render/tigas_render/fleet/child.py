"""One of the service's processes: started, listened to, started again when it has ended."""

from __future__ import annotations

import asyncio
import signal
import socket
import sys
import time
from asyncio.subprocess import DEVNULL, Process
from collections.abc import Callable, Sequence
from contextlib import suppress

from tigas_common.errors import StartError
from tigas_common.processes import BackOff, how_it_ended
from tigas_render.fleet.control import Channel, Failed, Message, Ready


class Child:
    """A process that is to run all the time."""

    def __init__(
        self,
        name: str,
        module: str,
        inherited: Sequence[socket.socket],
        begin: Callable[[], Sequence[Message]],
        heard: Callable[[Child, Message], None],
    ) -> None:
        """name: as it is called in a sentence; module: its program; begin: what it is told when it starts, a `Start`
        first; heard: what becomes of what it says.
        """
        self.name = name
        self.ready = asyncio.Event()
        """Whether it has ever served."""
        self._module = module
        self._inherited = [sock.fileno() for sock in inherited]
        self._begin = begin
        self._heard = heard
        self._process: Process | None = None
        self._channel: Channel | None = None
        self._failure: str | None = None
        self._stopping = asyncio.Event()
        self._ended = asyncio.Event()

    def tell(self, message: Message) -> None:
        """Say something to it; while it does not run, what it has to know then is in its beginning."""
        if self._channel is not None:
            self._channel.send(message)

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
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.send_signal(number)

    async def _run(self) -> int:
        """Run one process to its end; its exit status."""
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", self._module, str(theirs.fileno()), self.name),
                stdin=DEVNULL,
                pass_fds=(theirs.fileno(), *self._inherited),
                start_new_session=True,  # Ctrl+C is for the supervisor alone, which asks them to end in turn
            )
        if self._stopping.is_set():
            self._signal(signal.SIGTERM)
        self._failure = None
        self._channel = await Channel.over(ours)
        try:
            for message in self._begin():
                self._channel.send(message)
            async for message in self._channel:
                match message:
                    case Failed():
                        self._failure = message.detail
                        continue
                    case Ready():
                        self.ready.set()
                self._heard(self, message)
            return await self._process.wait()
        finally:
            channel, self._channel = self._channel, None
            await channel.close()
