"""What the supervisor and its children tell each other: a line of JSON each, over a Unix socket that a child inherits.

A child whose supervisor is gone reads the socket's end, and ends as well.
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
"""Bytes that wait for a process that does not read; more is dropped, since only tickets can be so many."""


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_bytes="base64", val_json_bytes="base64")


class NewCertificate(_Message):
    """Show this one from now on."""

    kind: Literal["certificate"] = "certificate"
    pem: bytes
    """With its private key."""


class EngineStart(_Message):
    """What an engine needs to begin."""

    kind: Literal["engine"] = "engine"
    name: str
    """As it is called in a sentence."""
    settings: RenderSettings
    """With its own device alone."""
    number: int
    devices: tuple[str, ...]
    """All engines', by number."""
    edges: int
    """How many will connect."""
    directory: Path
    """Where its sockets are to be."""
    http_port: int
    https_port: int | None
    quic_port: int | None
    certificate: NewCertificate


class EdgeStart(_Message):
    """What an edge needs to begin. Sockets are file descriptors that it inherits."""

    kind: Literal["edge"] = "edge"
    name: str
    """As it is called in a sentence."""
    settings: RenderSettings
    devices: tuple[str, ...]
    """What engines render on, by their numbers, each with a name of its own."""
    directory: Path
    """Where the engines' sockets are."""
    number: int
    edges: int
    http: int
    https: int | None
    quic: tuple[int, ...]
    relay: int | None
    """What others pass on to this edge, if the kernel steers nothing."""
    relays: tuple[int, ...]
    """What leads to each edge."""
    others: tuple[int, ...]
    """What is other edges' alone."""
    certificate: NewCertificate
    reset_key: bytes
    retry_key: bytes


class TicketIssued(_Message):
    """An edge has given a client this ticket, good for one resumption at any edge."""

    kind: Literal["issued"] = "issued"
    ticket: SessionTicket


class TicketTaken(_Message):
    """A client has used a ticket."""

    kind: Literal["taken"] = "taken"
    label: bytes


class Loaded(_Message):
    """The child can begin at once, when it is told to."""

    kind: Literal["loaded"] = "loaded"


class Said(_Message):
    """A line for the user, now."""

    kind: Literal["said"] = "said"
    line: str


class Ready(_Message):
    """The child serves now."""

    kind: Literal["ready"] = "ready"
    lines: tuple[str, ...] = ()
    """What the user is told once all serve."""


class Failed(_Message):
    """Why the child ends, in a sentence."""

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
        """The end that this socket is, which it owns from now on."""
        return cls(*await asyncio.open_unix_connection(sock=sock, limit=MAX_LINE))

    def send(self, message: Message) -> None:
        """Tell the other side, unless it is gone, or does not read."""
        transport = self._writer.transport
        if not transport.is_closing() and transport.get_write_buffer_size() < MAX_UNSENT:
            self._writer.write(message.model_dump_json().encode() + b"\n")

    async def __aiter__(self) -> AsyncIterator[Message]:
        """What the other side says, until it is gone."""
        try:
            while line := await self._reader.readline():
                yield _MESSAGE.validate_json(line)
        except ConnectionError:
            pass

    @property
    def is_over(self) -> bool:
        """Whether the other side is gone."""
        return self._reader.at_eof()

    async def close(self) -> None:
        """Close this end; what was said before still reaches the other."""
        self._writer.close()
        with suppress(ConnectionError):
            await self._writer.wait_closed()
