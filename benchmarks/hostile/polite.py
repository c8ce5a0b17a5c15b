"""The polite clients, in a separate process: a viewer at 30 frames/s, and newcomers.

Prints one line of JSON for each request: the client, the due time, and the milliseconds until the complete answer, or
null if it never came or was refused. Times are counted from the due time, so that late requests hide nothing.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
from collections.abc import Awaitable, Callable

from benchmarks.hostile.client import Client, connect, request
from benchmarks.hostile.services import Ports

ADDRESS = "127.0.0.2"
RATE = 30
IN_FLIGHT = 8
"""Maximum frames in flight of the viewer; a frame that is due beyond it counts as lost."""
PATIENCE_S = 10.0
LOW = json.dumps(request(profile=3)).encode()
PATHS = {"page": "/config.json", "dash": "/time", "store": "/experiments", "shaper": "/status"}
"""First request of a new visitor of each service, over a new connection of HTTP/1.1."""
COMES_EVERY_S = 0.5


def report(who: str, due: float, milliseconds: float | None) -> None:
    """One line."""
    print(json.dumps([who, due, milliseconds]), flush=True)


async def timed(who: str, due: float, ask: Callable[[], Awaitable[bool]]) -> None:
    """Ask, and report how long it took or that it failed."""
    good = False
    try:
        async with asyncio.timeout(PATIENCE_S):
            good = await ask()
    except (OSError, TimeoutError, ValueError, IndexError):
        pass
    report(who, due, 1000 * (time.monotonic() - due) if good else None)


async def viewer(ports: Ports) -> None:
    """Frames at a steady rate over one WebTransport session, which is opened anew if it breaks."""
    running: set[asyncio.Task[None]] = set()
    client: Client | None = None
    due = time.monotonic()

    async def visit() -> None:
        nonlocal client, due
        async with connect(ports.quic, ADDRESS) as client:
            session = await client.session()
            while not client.is_closed:
                due = max(due + 1 / RATE, time.monotonic() - PATIENCE_S)
                await asyncio.sleep(due - time.monotonic())
                if len(running) >= IN_FLIGHT:
                    report("viewer", due, None)
                    continue
                task = asyncio.create_task(timed("viewer", due, lambda: frame(client, session)))
                running.add(task)
                task.add_done_callback(running.discard)

    while True:
        try:
            await visit()
        except (OSError, TimeoutError):
            while (due := due + 1 / RATE) < time.monotonic():
                report("viewer", due, None)


async def frame(client: Client, session: int) -> bool:
    """Whether a frame arrived."""
    return await client.frame_status(session, LOW) == 200


async def newcomer(ports: Ports) -> bool:
    """A new viewer, up to its first frame."""
    async with connect(ports.quic, ADDRESS) as client:
        return await frame(client, await client.session())


async def visitor(port: int, path: str) -> bool:
    """A page or program that comes to a service."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, local_addr=(ADDRESS, 0))
    try:
        head = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n"
        writer.write(head.encode())
        return (await reader.read()).startswith(b"HTTP/1.1 200 ")
    finally:
        writer.close()


async def again_and_again(who: str, ask: Callable[[], Awaitable[bool]]) -> None:
    """A newcomer at a fixed interval, however long the earlier ones wait."""
    async with asyncio.TaskGroup() as group:
        due = time.monotonic()
        while True:
            group.create_task(timed(who, due, ask))
            due += COMES_EVERY_S
            await asyncio.sleep(due - time.monotonic())


async def main(ports: Ports, guests: list[str]) -> None:
    """The viewer, and these guests."""
    async with asyncio.TaskGroup() as group:
        group.create_task(viewer(ports))
        for who in guests:
            if who == "newcomer":
                group.create_task(again_and_again(who, lambda: newcomer(ports)))
            else:
                port = ports.render if who == "page" else getattr(ports, who)
                path = PATHS[who]
                group.create_task(again_and_again(who, lambda port=port, path=path: visitor(port, path)))  # type: ignore[misc]


if __name__ == "__main__":
    os.sched_setaffinity(0, set(map(int, sys.argv[2].split(","))))
    asyncio.run(main(Ports.parse(sys.argv[1]), sys.argv[3:]))
