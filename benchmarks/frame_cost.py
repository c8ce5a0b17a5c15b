"""Processor time of the server per frame: our transport against a stock aioquic server, in the same run.

    python -m benchmarks.frame_cost [--blocks 5] [--seconds 1] [--bytes 23000 197000] [--over webtransport post]

Both servers answer from memory, each in its own process, and take turns block by block; one client process sends
requests over loopback, a frame at a time for each viewer. Their time is the process's own clock (user and system) over
the frames of a block. See `benchmarks.servers` for their work; `post` goes through our HTTP application.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import random
import statistics
import time
from collections.abc import AsyncIterator, Callable, Coroutine

import uvloop

from benchmarks.hostile.client import Client, connect_as, request
from benchmarks.servers import NAMES, Server, running

VIEWERS = 4
WARM_UP_FRAMES = 30
"""Of each viewer, until the congestion window has grown."""
REQUEST = json.dumps(request(1280, 720, profile=0, deadline_ms=1000)).encode()


class Viewer(Client):
    """One connection."""

    async def post_request(self) -> None:
        """A frame by POST. Raises RuntimeError for any other answer."""
        if (await self.post("localhost", "/render", REQUEST)).status_code != 200:
            raise RuntimeError("A request was refused.")

    async def view(self, session: int) -> None:
        """A frame over WebTransport. Raises RuntimeError for any other answer."""
        if await self.frame_status(session, REQUEST) != 200:
            raise RuntimeError("A request was refused.")


Ask = Callable[[], Coroutine[None, None, object]]


async def asking(viewer: Viewer, over: str) -> Ask:
    """Requests a frame and reads it."""
    if over == "post":
        return viewer.post_request
    session = await viewer.session()
    return lambda: viewer.view(session)


@contextlib.asynccontextmanager
async def viewers(server: Server, over: str) -> AsyncIterator[list[Ask]]:
    async with contextlib.AsyncExitStack() as stack:
        window = {"max_data": 1 << 24, "max_stream_data": 1 << 24}
        connected = [
            await stack.enter_async_context(connect_as(Viewer, server.port, "127.0.0.1", **window))
            for _ in range(VIEWERS)
        ]
        yield [await asking(viewer, over) for viewer in connected]


async def frames(asks: list[Ask], go_on: Callable[[int], bool]) -> int:
    """Each asks again and again, while it may by how many it has had; how many all have had."""

    async def view(ask: Ask) -> int:
        count = 0
        while go_on(count):
            await ask()
            count += 1
        return count

    return sum(await asyncio.gather(*map(view, asks)))


async def measure(servers: dict[str, Server], over: str, blocks: int, seconds: float) -> dict[str, list[float]]:
    """Microseconds a frame in each block."""
    costs: dict[str, list[float]] = {name: [] for name in servers}
    async with contextlib.AsyncExitStack() as stack:
        asks = {name: await stack.enter_async_context(viewers(server, over)) for name, server in servers.items()}
        for each in asks.values():
            await frames(each, lambda count: count < WARM_UP_FRAMES)
        for _ in range(blocks):
            for name, server in servers.items():
                until = time.monotonic() + seconds
                before = server.cpu_seconds()
                count = await frames(asks[name], lambda _, until=until: time.monotonic() < until)  # type: ignore[misc]
                costs[name].append((server.cpu_seconds() - before) / count * 1e6)
    return costs


def interval(values: list[float]) -> str:
    """The mean, and its 95 % interval by the bootstrap over blocks."""
    generator = random.Random(0)
    means = sorted(statistics.fmean(generator.choices(values, k=len(values))) for _ in range(2000))
    three = statistics.fmean(values), means[50], means[-51]
    mean, low, high = (f"{value:.0f}" if value >= 100 else f"{value:.2f}" for value in three)
    return f"{mean:>5} ({low} to {high})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--blocks", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1, help="of a block")
    parser.add_argument("--bytes", type=int, nargs="+", default=[23_000, 197_000], help="of a frame")
    parser.add_argument("--over", nargs="+", choices=["webtransport", "post"], default=["webtransport", "post"])
    parser.add_argument("--servers", nargs="+", choices=NAMES, default=NAMES)
    arguments = parser.parse_args()
    print(f"µs of the server's processor a frame, mean of {arguments.blocks} blocks of {arguments.seconds:g} s (95 %)")
    for size in arguments.bytes:
        with contextlib.ExitStack() as stack:
            servers = {name: stack.enter_context(running(name, size)) for name in arguments.servers}
            for over in arguments.over:
                costs = uvloop.run(measure(servers, over, arguments.blocks, arguments.seconds))
                about = f"{size:9,} bytes  {over:12}"
                for name, each in costs.items():
                    print(f"{about}  {name:5} {interval(each)}")
                if len(costs) == 2:
                    ratios = [ours / stock for ours, stock in zip(costs["ours"], costs["stock"], strict=True)]
                    print(f"{about}  ratio {interval(ratios)}", flush=True)


if __name__ == "__main__":
    main()
