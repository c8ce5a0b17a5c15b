"""Resident memory of the server's process while frames go out: it must stay flat, over one connection and over
many.

    python -m benchmarks.memory [--frames 20000] [--connections 200] [--bytes 20000] [--seconds 300]

The server answers from memory in a separate process, so any growth is the transport's. Exits with 1 if resident memory
grows by more than 20 MB after the warm-up.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time

import uvloop

from benchmarks.hostile.client import connect, request
from benchmarks.servers import Server, running

LIMIT_MB = 20
IN_FLIGHT = 4
AT_ONCE = 2
"""Handshakes that an address may begin."""
WARM_UP = 2000
REQUEST = json.dumps(request()).encode()


async def watch(port: int, frames: int, deadline: float) -> int:
    """One connection that receives this many frames, a few at a time; returns the number received before the
    deadline.
    """
    got = 0
    async with connect(port, "127.0.0.1") as client:
        session = await client.session()

        async def worker(share: int) -> None:
            nonlocal got
            for _ in range(share):
                if time.monotonic() > deadline:
                    return
                await client.frame(session, REQUEST)
                got += 1

        shares = [frames // IN_FLIGHT + (number < frames % IN_FLIGHT) for number in range(IN_FLIGHT)]
        await asyncio.gather(*map(worker, shares))
    return got


async def crowd(port: int, connections: int, frames: int, deadline: float) -> int:
    """This many connections, a few at a time, each receiving this many frames; returns the total number of frames."""
    todo = iter(range(connections))

    async def one_after_another() -> int:
        return sum([await watch(port, frames, deadline) for _ in todo if time.monotonic() < deadline])

    return sum(await asyncio.gather(*(one_after_another() for _ in range(AT_ONCE))))


async def measure(name: str, server: Server, frames: int, connections: int, seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    each = max(1, frames // connections)
    await crowd(server.port, max(1, connections // 10), min(each, WARM_UP), deadline)
    before, start = server.megabytes(), time.monotonic()
    got = await crowd(server.port, connections, each, deadline)
    after, elapsed = server.megabytes(), time.monotonic() - start
    print(
        f"{name:16} {got:6,} frames, {connections} connections, {elapsed:5.1f} s:"
        f" {before:6.1f} MB before, {after:6.1f} MB after, {after - before:+.1f} MB",
        flush=True,
    )
    return after - before <= LIMIT_MB


async def main(arguments: argparse.Namespace) -> int:
    flat = True
    for name, connections in (("one connection", 1), ("many connections", arguments.connections)):
        with running("ours", arguments.bytes) as server:
            flat &= await measure(name, server, arguments.frames, connections, arguments.seconds)
    return 0 if flat else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--connections", type=int, default=200, help="of the second measurement")
    parser.add_argument("--bytes", type=int, default=20_000, help="of one frame")
    parser.add_argument("--seconds", type=float, default=300, help="limit for each measurement")
    options = parser.parse_args()
    sys.exit(uvloop.run(main(options)))
