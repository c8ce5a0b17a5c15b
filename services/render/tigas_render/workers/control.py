"""Messages between the supervisor and its workers: lines of JSON over a Unix socket that a worker inherits.

If the supervisor dies, its workers read the end of the socket, and end as well.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

from aioquic.tls import SessionTicket
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from tigas_render.settings import RenderSettings

MAX_LINE = 1 << 20
"""Bytes."""
MAX_UNSENT = 1 << 20
"""Bytes that wait for a process that does not read; beyond this, tickets are dropped."""


def http_socket(directory: Path, engine: int) -> Path:
    return directory / f"http-{engine}.sock"


def frames_socket(directory: Path, engine: int) -> Path:
    return directory / f"frames-{engine}.sock"


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_bytes="base64", val_json_bytes="base64")


class NewCertificate(_Message):
    """The certificate to show from now on."""

    kind: Literal["certificate"] = "certificate"
    pem: bytes
    """With its private key."""


class _Start(_Message):
    name: str
    """As it appears in a sentence."""
    settings: RenderSettings
    """An engine's have only its own device."""
    number: int
    devices: tuple[str, ...]
    """The names of the engines' devices, by number; no two are the same."""
    edges: int
    """The number of all edges."""
    directory: Path
    """The directory for the sockets of the engines, which only the user of the service may enter."""
    certificate: NewCertificate


class EngineStart(_Start):
    """The start of an engine."""

    kind: Literal["engine"] = "engine"
    http_port: int
    https_port: int | None
    quic_port: int | None


class EdgeStart(_Start):
    """The start of an edge. Sockets and memory are file descriptors that it inherits."""

    kind: Literal["edge"] = "edge"
    http: int
    https: int | None
    quic: tuple[int, ...]
    counts: int
    """The memory of the edges' numbers of connections."""
    reset_key: bytes
    retry_key: bytes


class TicketIssued(_Message):
    """A ticket that an edge has given to a client, good for one resumption at any edge."""

    kind: Literal["issued"] = "issued"
    ticket: SessionTicket


class TicketTaken(_Message):
    """The use of a ticket by a client."""

    kind: Literal["taken"] = "taken"
    label: bytes


class Loaded(_Message):
    """The worker has loaded its program."""

    kind: Literal["loaded"] = "loaded"


class Said(_Message):
    """A line to print at once."""

    kind: Literal["said"] = "said"
    line: str


class Ready(_Message):
    """The worker serves now."""

    kind: Literal["ready"] = "ready"
    lines: tuple[str, ...] = ()
    """The announcement to print once all workers serve."""


class Failed(_Message):
    """The reason why the worker ends, in a sentence."""

    kind: Literal["failed"] = "failed"
    detail: str


Start = EngineStart | EdgeStart
Message = Start | NewCertificate | TicketIssued | TicketTaken | Loaded | Said | Ready | Failed
_MESSAGE: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


class Channel:
    """One end of the socket."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    @classmethod
    async def over(cls, sock: socket.socket) -> Channel:
        """Wrap a socket, and own it from now on."""
        return cls(*await asyncio.open_unix_connection(sock=sock, limit=MAX_LINE))

    def send(self, message: Message) -> None:
        """Send a message, or drop it if the other side has ended, or reads no tickets."""
        transport = self._writer.transport
        is_ticket = isinstance(message, TicketIssued | TicketTaken)
        if not transport.is_closing() and (not is_ticket or transport.get_write_buffer_size() < MAX_UNSENT):
            self._writer.write(message.model_dump_json().encode() + b"\n")

    async def __aiter__(self) -> AsyncIterator[Message]:
        """The messages from the other side, until it ends."""
        try:
            while (line := await self._reader.readline()).endswith(b"\n"):  # not cut off by its sender's end
                yield _MESSAGE.validate_json(line)
        except ConnectionError:
            pass

    @property
    def is_over(self) -> bool:
        """Whether the other side has ended."""
        return self._reader.at_eof()

    async def close(self) -> None:
        """Close this end. Messages that were sent before still arrive."""
        self._writer.close()
        with suppress(ConnectionError):
            await self._writer.wait_closed()
