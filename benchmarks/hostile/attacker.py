"""The attacker: tools shared by all attacks, all from one address, and the list of attacks."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from typing import Any

from aioquic.h3.connection import ProtocolError
from aioquic.quic.connection import QuicConnectionError

from benchmarks.hostile.client import Client, connect
from benchmarks.hostile.services import Name, Ports

ADDRESS = "127.0.0.3"
PAUSE_S = 0.05
"""Before something that was refused is tried again."""


@dataclass(frozen=True, slots=True)
class Attacker:
    """Tools shared by all attacks."""

    ports: Ports
    done: Counter[str] = field(default_factory=Counter)
    """Counters of its actions and their results."""

    def connect(self, **configuration: Any) -> AbstractAsyncContextManager[Client]:
        """An HTTP/3 connection to the render service."""
        self.done["connections"] += 1
        return connect(self.ports.quic, ADDRESS, **configuration)

    async def ask(self, client: Client, session: int, request: bytes) -> None:
        """Request frames, one after the other, until the connection is closed."""
        while not client.is_closed:
            self.done[f"status {await client.frame_status(session, request)}"] += 1

    async def open(self, port: int) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """A TCP connection."""
        self.done["connections"] += 1
        return await asyncio.open_connection("127.0.0.1", port, local_addr=(ADDRESS, 0))

    async def post(self, port: int, path: str, body: bytes, *headers: str, method: str = "POST") -> tuple[int, bytes]:
        """The status and body of an answer over HTTP/1.1 and a new connection."""
        reader, writer = await self.open(port)
        try:
            writer.write(head(method, port, path, f"Content-Length: {len(body)}", "Connection: close", *headers))
            writer.write(body)
            await writer.drain()
            answer = await reader.read()
            status = int(answer.split(b" ", 2)[1])
            self.done[f"status {status}"] += 1
            return status, answer.partition(b"\r\n\r\n")[2]
        finally:
            writer.close()

    async def dribble(self, port: int, start: bytes, part: bytes, pause_s: float) -> None:
        """Begin a request, and send parts of it until the service ends it."""
        reader, writer = await self.open(port)
        try:
            writer.write(start)
            while not reader.at_eof():
                writer.write(part)
                self.done["parts"] += 1
                await writer.drain()
                await asyncio.sleep(pause_s)
            self.done["ended by the service"] += 1
            raise ConnectionResetError
        finally:
            writer.close()


@dataclass(frozen=True, slots=True)
class Attack:
    """One of them."""

    name: str
    attempt: Callable[[Attacker], Awaitable[object]]
    copies: int
    """Concurrent attempts."""
    service: Name
    """The service that is measured for memory."""
    guests: tuple[str, ...]
    """Polite clients in addition to the viewer: a newcomer, or visitors of the page or of a service."""

    async def run(self, attacker: Attacker) -> None:
        """Repeat the attempt, whatever the service's reaction, until cancelled."""

        async def one_after_another() -> None:
            while True:
                try:
                    await self.attempt(attacker)
                except (OSError, TimeoutError, ValueError, IndexError, QuicConnectionError, ProtocolError) as error:
                    attacker.done[type(error).__name__] += 1
                    await asyncio.sleep(PAUSE_S)

        await asyncio.gather(*(one_after_another() for _ in range(self.copies)))


ATTACKS: list[Attack] = []


def attack(
    *, name: str | None = None, copies: int = 1, service: Name = "render", guests: tuple[str, ...] = ()
) -> Callable[[Callable[[Attacker], Awaitable[object]]], None]:
    """Add a function, one attempt, to the attacks."""

    def add(attempt: Callable[[Attacker], Awaitable[object]]) -> None:
        ATTACKS.append(Attack(name or attempt.__name__.replace("_", "-"), attempt, copies, service, guests))

    return add


def head(method: str, port: int, path: str, *headers: str) -> bytes:
    """The head of a request over HTTP/1.1."""
    return "\r\n".join((f"{method} {path} HTTP/1.1", f"Host: 127.0.0.1:{port}", *headers, "", "")).encode()
