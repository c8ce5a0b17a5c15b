"""A client of HTTP/1.1 that sends exactly the bytes of a test."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

TIMEOUT_S = 20
ASK = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"


@dataclass(frozen=True)
class Answer:
    status: int
    body: bytes

    @property
    def problem(self) -> str:
        return str(json.loads(self.body)["type"])


@dataclass
class RawClient:
    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    def say(self, data: bytes) -> None:
        """Send this; it may be less than a request."""
        self.writer.write(data)

    async def answer(self) -> Answer:
        """The next response. Raises EOFError if the connection ends first."""
        async with asyncio.timeout(TIMEOUT_S):
            head = (await self.reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")
            fields = dict(line.lower().split(": ", 1) for line in head[1:-2])
            body = await self.reader.readexactly(int(fields["content-length"]))
        return Answer(int(head[0].split(" ")[1]), body)

    async def ended(self) -> bytes:
        """Wait until the server has closed the connection; returns the bytes received before that."""
        async with asyncio.timeout(TIMEOUT_S):
            try:
                return await self.reader.read()
            except ConnectionResetError:
                return b""


@asynccontextmanager
async def connected(port: int, source: str = "127.0.0.1") -> AsyncIterator[RawClient]:
    """A connection from this address, as a context manager."""
    async with asyncio.timeout(TIMEOUT_S):
        reader, writer = await asyncio.open_connection("127.0.0.1", port, local_addr=(source, 0))
    try:
        yield RawClient(reader, writer)
    finally:
        writer.close()
