"""The supervisor's view of worker processes, which it starts, supervises, and keeps in reserve."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import sys
import time
from asyncio.subprocess import DEVNULL, Process, create_subprocess_exec
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from tigas_common.errors import StartError
from tigas_common.processes import Backoff, SupervisedProcess, describe_exit
from tigas_render.workers.control import Channel, Failed, Loaded, Message, Ready

logger = logging.getLogger(__name__)

RETRY_S, MAX_RETRY_S = 15.0, 900.0
"""First and longest delay before restarting a failing worker while others replace it; it doubles each time."""
STANDBY_PAUSE_S = 2.0
"""Seconds between the use of a standby and the start of the next one, because returning viewers have priority."""


@dataclass(frozen=True, slots=True)
class WorkerProcess:
    """A worker's process, and the channel to it. It waits for a `Start` message."""

    process: Process
    channel: Channel

    @classmethod
    async def start(cls, program: str, inherited: Sequence[int]) -> WorkerProcess:
        """Start a module of this package that inherits these file descriptors. Raises OSError."""
        ours, theirs = socket.socketpair()
        try:
            with theirs:
                process = await create_subprocess_exec(
                    *(sys.executable, "-P", "-m", f"{__package__}.{program}", str(theirs.fileno())),
                    stdin=DEVNULL,
                    pass_fds=(theirs.fileno(), *inherited),
                    start_new_session=True,  # Ctrl+C is only for the supervisor, which then stops its workers
                )
            return cls(process, await Channel.from_socket(ours))
        except BaseException:
            ours.close()
            raise

    def signal(self, number: signal.Signals) -> None:
        """Send a signal, unless the process has exited."""
        with suppress(ProcessLookupError):
            self.process.send_signal(number)


class Worker(SupervisedProcess):
    """An edge or an engine. Others may take over its work while it is down."""

    def __init__(
        self,
        name: str,
        launch: Callable[[], Awaitable[WorkerProcess]],
        first_messages: Callable[[], Sequence[Message]],
        on_message: Callable[[Worker, Message], None],
    ) -> None:
        """name: in messages. launch: starts a new process. first_messages: returns those to it, beginning with a
        `Start`. on_message: called with the messages from it.
        """
        super().__init__(name)
        self.ready = asyncio.Event()
        """Set once the worker has served for the first time."""
        self.settled = asyncio.Event()
        """Set while the worker is not starting: it is serving, or has exited."""
        self.others: Sequence[Worker] = ()
        """The workers that can replace this one."""
        self._launch = launch
        self._first_messages = first_messages
        self._on_message = on_message
        self._running: WorkerProcess | None = None
        self._served_since: float | None = None
        self._failure: str | None = None
        self._retry_s: float | None = None

    def send(self, message: Message) -> None:
        """Send a message. If the worker is not running, the message is dropped: `begin` must return its content."""
        if self._running is not None:
            self._running.channel.send(message)

    async def run(self) -> None:
        """Run it until `stop`. Raises StartError if it fails to start or exits too often, and no other replaces it."""
        try:
            await super().run()
        finally:
            self.settled.set()

    async def _run(self) -> int | OSError:
        self._served_since = self._failure = None
        self.settled.clear()
        try:
            launched = self._running = await self._launch()
        except OSError as error:
            self.settled.set()
            return error
        if self._stopping.is_set():
            self._signal(signal.SIGTERM)
        try:
            for message in self._first_messages():
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
                self._on_message(self, message)
            return await launched.process.wait()
        finally:
            self._running = None
            self.settled.set()
            await launched.channel.close()

    async def _pause(self, status: int | OSError, delay_s: float | None) -> float:
        if self._served_s() > Backoff.WINDOW_S:
            self._retry_s = None
        if self._retry_s is None and self.ready.is_set() and delay_s is not None:
            why = f" {self._failure}" if self._failure else ""
            _warn(f"The {self.name} exited ({describe_exit(status)}); restarting it.{why}")
            return 0.0 if delay_s == Backoff.FIRST_S else delay_s  # at once the first time, because viewers are waiting
        if not await self._is_replaced():
            raise StartError(self._failure_message(status))
        self._retry_s = RETRY_S if self._retry_s is None else min(2 * self._retry_s, MAX_RETRY_S)
        _warn(f"{self._failure_message(status)} It is restarted in {self._retry_s:g} s; others replace it until then.")
        return self._retry_s

    def _signal(self, number: signal.Signals) -> None:
        if self._running is not None:
            self._running.signal(number)

    @property
    def _is_serving(self) -> bool:
        return self._running is not None and self._served_since is not None

    def _served_s(self) -> float:
        """Return the seconds for which the worker has been serving, or had been before it exited."""
        return 0.0 if self._served_since is None else time.monotonic() - self._served_since

    async def _is_replaced(self) -> bool:
        """Return whether another worker replaces this one. Waits while others are still starting."""
        while not any(other._is_serving for other in self.others):
            starting = [other for other in self.others if not other.settled.is_set()]
            if not starting:
                return False
            await starting[0].settled.wait()
        return True

    def _failure_message(self, status: int | OSError) -> str:
        """Explain why the worker is not simply restarted."""
        if not self.ready.is_set():
            if self._failure is None:
                return f"The {self.name} did not start ({describe_exit(status)})."
            return f"The {self.name} did not start: {self._failure}" if self.others else self._failure
        reason = f" {self._failure}" if self._failure else ""
        return (
            f"The {self.name} exited {Backoff.MAX_EXITS} times within {Backoff.WINDOW_S:g} s, the last time with "
            f"{describe_exit(status)}.{reason}"
        )


class Standby:
    """A standby edge, which replaces one that has exited, because starting Python takes seconds on a busy machine."""

    def __init__(self, inherited: Sequence[int]) -> None:
        """inherited: the file descriptors of all edges."""
        self._inherited = inherited
        self._task: asyncio.Task[WorkerProcess] | None = None
        """The standby process, until it is used."""
        self._loaded: asyncio.Queue[WorkerProcess] = asyncio.Queue()
        """The standby process, once it is waiting for its first message."""

    async def acquire(self) -> WorkerProcess:
        """Return a process for an edge: the standby, or a new one."""
        if not self._loaded.empty():
            waiting = self._loaded.get_nowait()
            self._loaded.task_done()
            self._task = None
            if waiting.process.returncode is None:
                return waiting
            await waiting.channel.close()
        return await WorkerProcess.start("edge", self._inherited)

    async def maintain(self) -> None:
        """Keep a standby until cancelled. Call `kill` after that."""
        while True:
            self._task = asyncio.create_task(WorkerProcess.start("standby_edge", self._inherited))
            try:
                launched = await asyncio.shield(self._task)
            except OSError as error:  # for example, a lack of memory for a fork
                self._task = None
                logger.warning("No spare edge could be started: %s", error)
            else:
                if await anext(aiter(launched.channel), None) is not None:  # the message `Loaded`
                    self._loaded.put_nowait(launched)
                    await self._loaded.join()
                else:
                    await launched.channel.close()
            await asyncio.sleep(STANDBY_PAUSE_S)

    async def kill(self) -> None:
        """Kill the standby, which has no work to finish."""
        if self._task is None:
            return
        with suppress(OSError):  # it was about to start, but failed
            launched = await self._task
            launched.signal(signal.SIGKILL)
            await launched.process.wait()
            await launched.channel.close()


def _warn(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
