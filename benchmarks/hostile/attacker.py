"""The attacker, in a process of its own and from one address: carries out one attack until it is told to stop.

Prints a line when it begins, and at the end what it has done: an attack that did nothing proves nothing.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from typing import Any

from aioquic.h3.connection import ProtocolError
from aioquic.quic.connection import QuicConnectionError

from benchmarks.hostile.client import Client, connect
from benchmarks.hostile.services import Ports

ADDRESS = "127.0.0.3"
PAUSE_S = 0.05
"""Before something that was refused is tried again."""


@dataclass(frozen=True, slots=True)
class Attacker:
    """What every attack has at hand."""

    ports: Ports
    done: Counter[str] = field(default_factory=Counter)
    """What it has done, and what came of it."""

    def connect(self, **configuration: Any) -> AbstractAsyncContextManager[Client]:
        """An HTTP/3 connection to the render service."""
        return connect(self.ports.quic, ADDRESS, **configuration)

    async def open(self, port: int) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """A TCP connection."""
        self.done["connections"] += 1
        return await asyncio.open_connection("127.0.0.1", port, local_addr=(ADDRESS, 0))

    async def post(self, port: int, path: str, body: bytes, *headers: str) -> tuple[int, bytes]:
        """The status and body of an answer over HTTP/1.1 and a connection of its own."""
        reader, writer = await self.open(port)
        try:
            writer.write(head("POST", port, path, f"Content-Length: {len(body)}", "Connection: close", *headers))
            writer.write(body)
            await writer.drain()
            answer = await reader.read()
            status = int(answer.split(b" ", 2)[1])
            self.done[f"status {status}"] += 1
            return status, answer.partition(b"\r\n\r\n")[2]
        finally:
            writer.close()

    async def again(self, attempt: Callable[[], Awaitable[object]], copies: int = 1) -> None:
        """Make an attempt again and again, so many at a time, whatever the service does about it."""

        async def one_after_another() -> None:
            while True:
                try:
                    await attempt()
                except (OSError, TimeoutError, ValueError, IndexError, QuicConnectionError, ProtocolError) as error:
                    self.done[type(error).__name__] += 1
                    await asyncio.sleep(PAUSE_S)

        await asyncio.gather(*(one_after_another() for _ in range(copies)))


def head(method: str, port: int, path: str, *headers: str) -> bytes:
    """The head of a request over HTTP/1.1."""
    return "\r\n".join((f"{method} {path} HTTP/1.1", f"Host: 127.0.0.1:{port}", *headers, "", "")).encode()


async def main(attack: Callable[[Attacker], Awaitable[None]], ports: Ports) -> None:
    """Carry out an attack until SIGTERM, and then go without a word to the services."""
    attacker = Attacker(ports)

    def stop(*_: object) -> None:
        print(json.dumps(attacker.done), flush=True)
        os._exit(0)

    signal.signal(signal.SIGTERM, stop)  # the loop may be too busy to hear of it
    print("begun", flush=True)
    await attack(attacker)


if __name__ == "__main__":
    from benchmarks.hostile.attacks import ATTACKS

    os.sched_setaffinity(0, set(map(int, sys.argv[2].split(","))))
    os.nice(19)
    (chosen,) = (one for one in ATTACKS if one.name == sys.argv[3])
    asyncio.run(main(chosen.run, Ports.parse(sys.argv[1])))
