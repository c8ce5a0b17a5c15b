"""The viewers, in several processes: seen from the measuring process (`Crowds`), and in one of them (`Crowd`).

As a program it is one of the processes. The first line of its input is a Plan; then follow commands, one per line.
`viewers N` sets the number of viewers in all processes together. `inside` answers with the number of sessions. `measure
BEGIN END`, in seconds of the monotonic clock, answers with an Observed afterwards. It ends with its input.
"""

from __future__ import annotations

import asyncio
import gc
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Self

import uvloop

from benchmarks.load.plan import ARRIVALS_PER_S, PATIENCE_S, Plan
from benchmarks.load.step import Observed
from benchmarks.load.viewer import Viewer
from tigas_common import processes

END_S = 5
FULL_S = 7.0
"""A service without a new session for this many seconds is full: refused viewers have tried again by then."""
ASK_EVERY_S = 0.25


class Crowds:
    """Viewers of one service, in several processes; a context manager."""

    def __init__(self, plan: Plan, count: int) -> None:
        self._plan = plan
        self._count = count
        self._processes: list[subprocess.Popen[bytes]] = []
        self._viewers = 0

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            for place in range(self._count):
                command = [sys.executable, "-m", "benchmarks.load.crowd", str(place), str(self._count)]
                pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
                process = stack.enter_context(processes.run_process(command, END_S, **pipes))
                assert process.stdin is not None
                stack.enter_context(suppress(BrokenPipeError))  # of a process that has ended
                stack.callback(process.stdin.close)
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
                process.stdin.write(f"{line}\n".encode())
                process.stdin.flush()
            except BrokenPipeError:
                raise RuntimeError("A process of viewers has ended.") from None

    def _answers(self) -> list[str]:
        """The next line of every process."""
        lines = []
        for process in self._processes:
            assert process.stdout is not None
            lines.append(process.stdout.readline().decode())
        if not all(lines):
            raise RuntimeError("A process of viewers has ended.")
        return lines


class Crowd:
    """The viewers of one process."""

    def __init__(self, plan: Plan, place: int, places: int) -> None:
        """place: index of this process among all of them; viewers are distributed round robin."""
        self._plan = plan
        self._place, self._places = place, places
        self._viewers: list[Viewer] = []
        self._arrivals: list[asyncio.TimerHandle] = []

    def set(self, count: int) -> None:
        """Set the number of viewers in all processes together; new ones start one after the other."""
        mine = len(range(self._place, count, self._places))
        for arrival in self._arrivals:
            arrival.cancel()
        while len(self._viewers) > mine:
            self._viewers.pop().leave()
        later = asyncio.get_running_loop().call_later
        self._arrivals = [
            later((step * self._places + self._place) / ARRIVALS_PER_S, self._add)
            for step in range(mine - len(self._viewers))
        ]

    def _add(self) -> None:
        viewer = Viewer(self._plan, self._place + len(self._viewers) * self._places)
        self._viewers.append(viewer)
        viewer.come()

    @property
    def inside(self) -> int:
        """How many have a session."""
        return sum(viewer.is_inside for viewer in self._viewers)

    async def measure(self, begin: float, end: float) -> Observed:
        """Their observations in a future interval."""
        await asyncio.sleep(begin - time.monotonic())
        for viewer in self._viewers:
            viewer.ended.clear()
        cpu = -time.process_time()
        await asyncio.sleep(end - time.monotonic())
        cpu += time.process_time()
        outside = len(self._viewers) - self.inside
        await asyncio.sleep(PATIENCE_S)
        ended = [one for viewer in self._viewers for one in viewer.ended]
        waiting = [due for viewer in self._viewers for due in viewer.waiting()]
        return Observed.of(ended, waiting, (begin, end), outside, cpu)


async def main(place: int, places: int) -> None:
    """Execute the commands of the input."""
    reader = asyncio.StreamReader(limit=1 << 26)
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    crowd = Crowd(Plan.from_json((await reader.readline()).decode()), place, places)
    gc.collect()
    gc.freeze()
    while command := (await reader.readline()).decode().split():
        match command:
            case ["viewers", count]:
                crowd.set(int(count))
            case ["inside"]:
                print(crowd.inside, flush=True)
            case ["measure", begin, end]:
                print((await crowd.measure(float(begin), float(end))).to_json(), flush=True)


if __name__ == "__main__":
    uvloop.run(main(int(sys.argv[1]), int(sys.argv[2])))
