"""Services as processes of their own: how one is started, how it ends, and how it is kept running."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tigas_common.errors import StartError

POLL_S = 0.2
STOP_S = 3
"""A service that has not stopped by then is killed, in seconds."""
START_S = 30
"""What ends with an error sooner than this after its first start has wrong settings: another start would not help."""


def tigas(*arguments: str) -> list[str]:
    """A command line of the `tigas` that this process belongs to."""
    return [sys.executable, "-m", "tigas_common", *arguments]


def with_parent(argv: list[str]) -> list[str]:
    """The command line of a process that is asked to end when the thread that starts it does, however that ends.

    Without setpriv (util-linux), it is left to its parent to end it.
    """
    return ["setpriv", "--pdeathsig", "TERM", *argv] if shutil.which("setpriv") else argv


def end(process: subprocess.Popen[bytes], patience_s: float) -> None:
    """Ask a process that leads a session to end; what has not ended after so long is killed, with all of its group."""
    process.terminate()
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@dataclass(frozen=True, slots=True)
class Service:
    """A process that is to run all the time."""

    name: str
    """As it is called in a sentence."""
    start: Callable[[], subprocess.Popen[bytes]]
    """Starts it, as the leader of a session."""


class BackOff:
    """How long to wait before each new start: twice as long as before, unless the last end is WINDOW_S ago."""

    FIRST_S = 0.5
    ENDS = 5
    """So many ends within WINDOW_S are too many."""
    WINDOW_S = 60.0

    def __init__(self) -> None:
        self._ends: deque[float] = deque()

    def ended(self, now: float) -> float | None:
        """How long to wait after an end at this time, in seconds, or None if it is one too many."""
        while self._ends and self._ends[0] <= now - self.WINDOW_S:
            self._ends.popleft()
        self._ends.append(now)
        return None if len(self._ends) >= self.ENDS else self.FIRST_S * 2 ** (len(self._ends) - 1)


def keep_running(services: Sequence[Service], stop: threading.Event) -> None:
    """Run services until `stop` is set, then end them. One that ends by itself is started again, and a line says so.

    Raises StartError for one that does not start or ends too often; the others are ended then.
    """
    running: list[_Running] = []
    try:
        for service in services:
            running.append(_Running(service, time.monotonic()))
        while not stop.wait(POLL_S):
            for each in running:
                each.look(time.monotonic())
    finally:
        for each in reversed(running):
            end(each.process, STOP_S)


class _Running:
    """One service: its process now, or when there is to be another."""

    def __init__(self, service: Service, now: float) -> None:
        self._service = service
        self._back_off = BackOff()
        self._first_start = now
        self._due: float | None = None
        self.process = service.start()

    def look(self, now: float) -> None:
        """Do what is due. Raises StartError."""
        if self._due is not None:
            if now >= self._due:
                self.process, self._due = self._service.start(), None
        elif (status := self.process.poll()) is not None:
            self._ended(status, now)

    def _ended(self, status: int, now: float) -> None:
        name, how = self._service.name, how_it_ended(status)
        if status > 0 and now < self._first_start + START_S:
            raise StartError(f"The {name} did not start ({how}), so the others end, too.")
        delay = self._back_off.ended(now)
        if delay is None:
            raise StartError(
                f"The {name} has ended {BackOff.ENDS} times within {BackOff.WINDOW_S:g} s, the last time with {how}: "
                "it is not started again, and the others end, too."
            )
        print(f"The {name} has ended ({how}); it is started again in {delay:g} s.", file=sys.stderr, flush=True)
        self._due = now + delay


def how_it_ended(status: int) -> str:
    return f"exit status {status}" if status >= 0 else f"signal {signal.Signals(-status).name}"
