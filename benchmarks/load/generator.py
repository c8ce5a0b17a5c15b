"""A process of viewers. The first line of its input is a Plan; then follow commands, one per line.

`viewers N` sets the number of viewers in all processes together. `inside` answers with the number of sessions. `measure
BEGIN END`, in seconds of the monotonic clock, answers with an Observed afterwards. It ends with its input.
"""

from __future__ import annotations

import asyncio
import gc
import sys
import time

import uvloop

from benchmarks.load.observed import Observed
from benchmarks.load.plan import ARRIVALS_PER_S, PATIENCE_S, Plan
from benchmarks.load.viewer import Viewer


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

    @property
    def _dropped(self) -> int:
        return sum(viewer.dropped for viewer in self._viewers)

    async def measure(self, begin: float, end: float) -> Observed:
        """Their observations in a future interval."""
        await asyncio.sleep(begin - time.monotonic())
        for viewer in self._viewers:
            viewer.ended.clear()
        cpu, dropped = -time.process_time(), -self._dropped
        await asyncio.sleep(end - time.monotonic())
        cpu, dropped = cpu + time.process_time(), dropped + self._dropped
        outside = len(self._viewers) - self.inside
        await asyncio.sleep(PATIENCE_S)
        ended = [one for viewer in self._viewers for one in viewer.ended]
        waiting = [due for viewer in self._viewers for due in viewer.waiting()]
        return Observed.of(ended, waiting, (begin, end), outside, cpu, dropped)


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
