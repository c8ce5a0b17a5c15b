"""Child processes: command lines, orderly shutdown, and supervision with restarts."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from tigas_common.errors import StartError

POLL_S = 0.2
STOP_S = 3
"""Seconds before a service that has not stopped is killed."""
START_S = 30
"""Seconds after the first start within which an exit with an error means wrong settings, not worth a restart."""


def tigas_command(*arguments: str) -> list[str]:
    """Return the command line for a `tigas` command of this installation."""
    return [sys.executable, "-m", "tigas_common", *arguments]


def end_with_parent(argv: list[str]) -> list[str]:
    """Return the command line for a process that gets SIGTERM when the thread that started it ends.

    Without setpriv (util-linux), the parent has to end it.
    """
    return ["setpriv", "--pdeathsig", "TERM", *argv] if shutil.which("setpriv") else argv


def terminate(process: subprocess.Popen[bytes], timeout_s: float) -> None:
    """Terminate the leader of a session; kill its whole process group if it takes longer than `timeout_s`."""
    process.terminate()
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


async def wait_or_kill(process: asyncio.subprocess.Process, timeout_s: float) -> None:
    """Wait until a process has ended; kill it if that takes longer than `timeout_s`."""
    try:
        async with asyncio.timeout(timeout_s):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()


@contextmanager
def run_process(argv: list[str], timeout_s: float, **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process until the context ends or this process is killed.

    timeout_s: as in `terminate`. options: further arguments for Popen.
    """
    process = subprocess.Popen(end_with_parent(argv), start_new_session=True, **options)
    try:
        yield process
    finally:
        terminate(process, timeout_s)
        for output in (process.stdout, process.stderr):
            if output is not None:
                output.close()


@contextmanager
def interrupt_on_sigterm() -> Iterator[None]:
    """Raise KeyboardInterrupt for SIGTERM as for Ctrl+C, so that contexts clean up. An event loop may override both."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def handle_sigterm_as_ctrl_c() -> None:
    """Handle SIGTERM like Ctrl+C, and restore Ctrl+C in background jobs of scripts, so that any end cleans up."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))


class Backoff:
    """The delay before each restart, doubled for every exit within the last WINDOW_S seconds."""

    FIRST_S = 0.5
    MAX_EXITS = 5
    """The number of exits within WINDOW_S that is too many."""
    WINDOW_S = 60.0

    def __init__(self) -> None:
        self._exits: deque[float] = deque()

    def next_delay_s(self, now: float) -> float | None:
        """Return the delay after an exit at this time, in seconds, or None after too many exits."""
        while self._exits and self._exits[0] <= now - self.WINDOW_S:
            self._exits.popleft()
        self._exits.append(now)
        return None if len(self._exits) >= self.MAX_EXITS else self.FIRST_S * 2 ** (len(self._exits) - 1)


class SupervisedProcess(ABC):
    """A process that is restarted whenever it exits."""

    def __init__(self, name: str) -> None:
        """name: as used in messages."""
        self.name = name
        self._stopping = asyncio.Event()
        self._ended = asyncio.Event()

    async def run(self) -> None:
        """Run the process until `stop` is called. Raises StartError if it should not be restarted."""
        back_off = Backoff()
        try:
            while not self._stopping.is_set():
                status = await self._run()
                if self._stopping.is_set():
                    return
                if pause_s := await self._pause(status, back_off.next_delay_s(time.monotonic())):
                    with suppress(TimeoutError):
                        async with asyncio.timeout(pause_s):
                            await self._stopping.wait()
        finally:
            self._ended.set()

    async def stop(self, timeout_s: float) -> None:
        """Terminate the process and stop restarting it; kill it if it takes longer than `timeout_s`."""
        self._stopping.set()
        self._signal(signal.SIGTERM)
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                await self._ended.wait()
        self._signal(signal.SIGKILL)
        await self._ended.wait()

    @abstractmethod
    async def _run(self) -> int | OSError:
        """Run one process to its end. Returns its exit status, or the error that kept it from starting."""

    @abstractmethod
    async def _pause(self, status: int | OSError, delay_s: float | None) -> float:
        """Return the seconds until the next start. Raises StartError to give up.

        delay_s: from the Backoff; None after too many exits.
        """

    @abstractmethod
    def _signal(self, number: signal.Signals) -> None:
        """Send a signal to the process, if it is running."""


class Service(SupervisedProcess):
    """A service that others depend on: if it cannot be kept running, they are stopped too."""

    def __init__(self, name: str, start: Callable[[], subprocess.Popen[bytes]]) -> None:
        """start: starts the process as the leader of a session."""
        super().__init__(name)
        self._start = start
        self._process: subprocess.Popen[bytes] | None = None
        self._first_start: float | None = None
        """Time of the first successful start."""

    async def _run(self) -> int | OSError:
        try:
            process = self._process = self._start()  # not in a worker thread, as it would end with the thread
        except OSError as error:  # such as a fork without enough memory
            return error
        if self._first_start is None:
            self._first_start = time.monotonic()
        status = await asyncio.to_thread(process.wait)
        self._process = None
        return status

    async def _pause(self, status: int | OSError, delay_s: float | None) -> float:
        how = describe_exit(status)
        if self._first_start is None:
            raise StartError(f"The {self.name} did not start ({how}).")
        if isinstance(status, int) and status > 0 and time.monotonic() < self._first_start + START_S:
            raise StartError(f"The {self.name} did not start ({how}), so the others end as well.")
        if delay_s is None:
            raise StartError(
                f"The {self.name} exited {Backoff.MAX_EXITS} times within {Backoff.WINDOW_S:g} s, the last time with "
                f"{how}: it is not restarted, and the others end as well."
            )
        print(f"The {self.name} exited ({how}); restarting it in {delay_s:g} s.", file=sys.stderr, flush=True)
        return delay_s

    def _signal(self, number: signal.Signals) -> None:
        if self._process is None:
            return
        if number == signal.SIGKILL:
            with suppress(ProcessLookupError):  # it has just exited
                os.killpg(self._process.pid, number)
        else:
            self._process.send_signal(number)


def keep_running(services: Sequence[Service], stop: threading.Event) -> None:
    """Run services until `stop` is set, then end them in reverse order.

    Raises StartError if a service does not start or exits too often, after ending the others.
    """
    asyncio.run(_keep_running(services, stop))


async def _keep_running(services: Sequence[Service], stop: threading.Event) -> None:
    kept = [asyncio.create_task(service.run()) for service in services]
    stopped = asyncio.create_task(_until_set(stop))
    try:
        await asyncio.wait((stopped, *kept), return_when=asyncio.FIRST_COMPLETED)
    finally:
        stopped.cancel()
        for service in reversed(services):
            await service.stop(STOP_S)
    await asyncio.gather(*kept)


async def _until_set(event: threading.Event) -> None:
    while not event.is_set():  # noqa: ASYNC110 - set by another thread
        await asyncio.sleep(POLL_S)


def describe_exit(status: int | OSError) -> str:
    """Describe an exit status, or the error that kept a process from starting."""
    if isinstance(status, OSError):
        return f"no process could be started: {status.strerror or status}"
    return f"exit status {status}" if status >= 0 else f"signal {signal.Signals(-status).name}"
