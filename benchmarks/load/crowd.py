"""The viewers' processes, from the measuring process."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Self

from benchmarks.load.observed import Observed
from benchmarks.load.plan import ARRIVALS_PER_S, PATIENCE_S, Plan
from tigas_common.processes import with_parent

END_S = 5
FULL_S = 7.0
"""A service without a new session for this many seconds is full: refused viewers have tried again by then."""
ASK_EVERY_S = 0.25


class Crowds:
    """Viewers of one service, in several processes; a context manager."""

    def __init__(self, plan: Plan, processes: int) -> None:
        self._plan = plan
        self._count = processes
        self._processes: list[subprocess.Popen[str]] = []
        self._viewers = 0

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            for place in range(self._count):
                command = [sys.executable, "-m", "benchmarks.load.generator", str(place), str(self._count)]
                process = subprocess.Popen(
                    with_parent(command), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
                )
                stack.callback(_end, process)
                self._processes.append(process)
            self._tell(self._plan.to_json())
            self._ending = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.close()

    def measure(self, viewers: int, warm_up_s: float, seconds: float, wait: Callable[[float], None]) -> Observed:
        """Observations of this many viewers over `seconds`, once they are connected and have looked around for
        `warm_up_s`.

        `wait` waits until a time of the monotonic clock: first the start, then the end of the measurement. Raises
        RuntimeError if a process has ended.
        """
        self._tell(f"viewers {viewers}")
        self._arrive(viewers)
        begin = time.monotonic() + warm_up_s
        end = begin + seconds
        self._tell(f"measure {begin} {end}")
        wait(begin)
        wait(end + PATIENCE_S)
        return Observed.together([Observed.from_json(line) for line in self._answers()])

    def _arrive(self, viewers: int) -> None:
        """Wait until all have a session, or the service counts as full."""
        inside, since = -1, time.monotonic() + max(0, viewers - self._viewers) / ARRIVALS_PER_S
        self._viewers = viewers
        while inside < viewers and time.monotonic() < since + FULL_S:
            time.sleep(ASK_EVERY_S)
            self._tell("inside")
            now_inside = sum(map(int, self._answers()))
            if now_inside > inside:
                inside, since = now_inside, max(since, time.monotonic())

    def clear(self) -> None:
        """Let all viewers leave."""
        self._viewers = 0
        self._tell("viewers 0")

    def _tell(self, line: str) -> None:
        for process in self._processes:
            assert process.stdin is not None
            try:
                process.stdin.write(line + "\n")
                process.stdin.flush()
            except BrokenPipeError:
                raise RuntimeError("A process of viewers has ended.") from None

    def _answers(self) -> list[str]:
        """The next line of every process."""
        lines = []
        for process in self._processes:
            assert process.stdout is not None
            lines.append(process.stdout.readline())
        if not all(lines):
            raise RuntimeError("A process of viewers has ended.")
        return lines


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    with suppress(BrokenPipeError), process:
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
