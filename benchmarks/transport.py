"""Our transport against a stock aioquic server, in the same run: processor time of a frame.

    python -m benchmarks.transport [--blocks 5] [--seconds 1] [--bytes 23000 197000] [--over webtransport post]

Both servers answer from memory, each in its own process (`benchmarks.servers`), and take turns block by block. One
client process requests frames over loopback, one at a time for each of four viewers; the server's time is its process's
own clock (user and system) over the frames of a block.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import random
import statistics
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial

import uvloop

from benchmarks.hostile.client import Client, connect, request
from benchmarks.servers import NAMES, Server, running

VIEWERS = 4
WARM_UP_FRAMES = 30
"""Of each viewer, until the congestion window has grown."""
REQUEST = request(1280, 720, profile=0, deadline_ms=1000)
BODY = json.dumps(REQUEST).encode()


async def view(client: Client, session: int) -> None:
    """A frame over WebTransport."""
    assert await client.frame_status(session, BODY) == 200


async def post(client: Client) -> None:
    """A frame by POST, through our HTTP application."""
    assert (await client.post("localhost", "/render", BODY)).status_code == 200


@contextlib.asynccontextmanager
async def viewers(server: Server, over: str) -> AsyncIterator[list[Callable[[], Awaitable[None]]]]:
    """Viewers that request a frame and read it."""
    async with contextlib.AsyncExitStack() as stack:
        asks: list[Callable[[], Awaitable[None]]] = []
        for _ in range(VIEWERS):
            window = {"max_data": 1 << 24, "max_stream_data": 1 << 24}
            client = await stack.enter_async_context(connect(server.port, "127.0.0.1", **window))
            asks.append(partial(post, client) if over == "post" else partial(view, client, await client.session()))
        yield asks


async def frames(asks: list[Callable[[], Awaitable[None]]], go_on: Callable[[int], bool]) -> int:
    """Let each ask while it may, by its number of frames; returns the total."""

    async def repeat(ask: Callable[[], Awaitable[None]]) -> int:
        count = 0
        while go_on(count):
            await ask()
            count += 1
        return count

    return sum(await asyncio.gather(*map(repeat, asks)))


async def processor_us(servers: dict[str, Server], over: str, blocks: int, seconds: float) -> dict[str, list[float]]:
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


def report(about: str, values: dict[str, list[float]]) -> None:
    """Print the mean over blocks of each server, and of their ratios."""
    for name, each in values.items():
        print(f"{about}  {name:5} {interval(each)} µs of the processor a frame")
    ratios = [ours / stock for ours, stock in zip(values["ours"], values["stock"], strict=True)]
    print(f"{about}  ratio {interval(ratios)}", flush=True)


def interval(values: list[float]) -> str:
    """The mean, and its 95 % interval by the bootstrap over blocks."""
    generator = random.Random(0)
    means = sorted(statistics.fmean(generator.choices(values, k=len(values))) for _ in range(2000))
    three = statistics.fmean(values), means[50], means[-51]
    mean, low, high = (f"{value:.0f}" if value >= 100 else f"{value:.2f}" for value in three)
    return f"{mean:>5} ({low} to {high})"


def main() -> None:
    ways = ("webtransport", "post")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blocks", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1, help="of a block")
    parser.add_argument("--bytes", type=int, nargs="+", default=[23_000, 197_000], help="of a frame")
    parser.add_argument("--over", nargs="+", choices=ways, default=ways)
    arguments = parser.parse_args()
    print(f"Means of {arguments.blocks} blocks of {arguments.seconds:g} s (95 %)")
    for size in arguments.bytes:
        with contextlib.ExitStack() as stack:
            servers = {name: stack.enter_context(running(name, size)) for name in NAMES}
            for over in arguments.over:
                costs = uvloop.run(processor_us(servers, over, arguments.blocks, arguments.seconds))
                report(f"{size:9,} bytes, {over}", costs)


if __name__ == "__main__":
    main()
