"""Messages between the supervisor and its workers: lines of JSON over a Unix socket that a worker inherits.

If the supervisor dies, its workers read the end of the stream, and exit as well.
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
"""Maximum length of a line in bytes."""
MAX_UNSENT = 1 << 20
"""Number of unsent bytes, for a process that does not read, above which tickets are dropped."""


def http_socket(directory: Path, engine: int) -> Path:
    return directory / f"http-{engine}.sock"


def frames_socket(directory: Path, engine: int) -> Path:
    return directory / f"frames-{engine}.sock"


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_bytes="base64", val_json_bytes="base64")


class NewCertificate(_Message):
    """The certificate to use from now on."""

    kind: Literal["certificate"] = "certificate"
    pem: bytes
    """Private key and certificate, from `Certificate.pem_with_key`."""


class _Start(_Message):
    name: str
    """Name of the worker in messages."""
    settings: RenderSettings
    """The service's settings, but for an engine with only its own device."""
    number: int
    devices: tuple[str, ...]
    """Unique names of the engines' devices, by engine number."""
    edges: int
    """Total number of edges."""
    directory: Path
    """Directory of the engines' sockets, which only the user of the service may enter."""
    certificate: NewCertificate


class EngineStart(_Start):
    """The start of an engine."""

    kind: Literal["engine"] = "engine"
    http_port: int
    https_port: int | None
    quic_port: int | None


class EdgeStart(_Start):
    """The start of an edge. Sockets and shared memory are file descriptors that it inherits."""

    kind: Literal["edge"] = "edge"
    http: int
    https: int | None
    quic: tuple[int, ...]
    counts: int
    """The shared memory for the edges' numbers of connections."""
    reset_key: bytes
    retry_key: bytes


class TicketIssued(_Message):
    """A ticket that an edge has issued to a client, valid for one resumption at any edge."""

    kind: Literal["issued"] = "issued"
    ticket: SessionTicket


class TicketTaken(_Message):
    """The use of a ticket by a client."""

    kind: Literal["taken"] = "taken"
    label: bytes


class Loaded(_Message):
    """The worker has imported its modules."""

    kind: Literal["loaded"] = "loaded"


class PrintLine(_Message):
    """A line to print immediately."""

    kind: Literal["said"] = "said"
    line: str


class Ready(_Message):
    """The worker has started to serve."""

    kind: Literal["ready"] = "ready"
    lines: tuple[str, ...] = ()
    """The announcement to print once all workers are serving."""


class Failed(_Message):
    """The reason why the worker exits, in one sentence."""

    kind: Literal["failed"] = "failed"
    detail: str


Start = EngineStart | EdgeStart
Message = Start | NewCertificate | TicketIssued | TicketTaken | Loaded | PrintLine | Ready | Failed
_MESSAGE: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


class Channel:
    """One end of the socket between the supervisor and a worker."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    @classmethod
    async def from_socket(cls, sock: socket.socket) -> Channel:
        """Create a channel over a socket, which it owns from now on."""
        return cls(*await asyncio.open_unix_connection(sock=sock, limit=MAX_LINE))

    def send(self, message: Message) -> None:
        """Send a message. It is dropped if the other side has exited, or if it is a ticket and too much is unsent."""
        transport = self._writer.transport
        is_ticket = isinstance(message, TicketIssued | TicketTaken)
        if not transport.is_closing() and (not is_ticket or transport.get_write_buffer_size() < MAX_UNSENT):
            self._writer.write(message.model_dump_json().encode() + b"\n")

    async def __aiter__(self) -> AsyncIterator[Message]:
        """Yield the messages from the other side, until it exits."""
        try:
            while (line := await self._reader.readline()).endswith(b"\n"):  # not cut off because the sender exited
                yield _MESSAGE.validate_json(line)
        except ConnectionError:
            pass

    @property
    def is_closed(self) -> bool:
        """Whether the other side has exited."""
        return self._reader.at_eof()

    async def close(self) -> None:
        """Close this end. Messages that have been sent still arrive."""
        self._writer.close()
        with suppress(ConnectionError):
            await self._writer.wait_closed()
