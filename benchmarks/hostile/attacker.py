"""The attacker: tools shared by all attacks, all from one address."""

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
from benchmarks.hostile.services import Ports

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
        return connect(self.ports.quic, ADDRESS, **configuration)

    async def open(self, port: int) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """A TCP connection."""
        self.done["connections"] += 1
        return await asyncio.open_connection("127.0.0.1", port, local_addr=(ADDRESS, 0))

    async def post(self, port: int, path: str, body: bytes, *headers: str) -> tuple[int, bytes]:
        """The status and body of an answer over HTTP/1.1 and a new connection."""
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
        """Repeat an attempt with this concurrency, whatever the service's reaction."""

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
