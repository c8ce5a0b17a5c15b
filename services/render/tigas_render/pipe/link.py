"""One end of a pipe on the event loop, which sends messages in batches and receives them one by one.

A message is the length of its content, its kind, and the content, a pickled tuple of plain values. This is safe because
both ends have the same version and user: they are started by the same process.
"""

from __future__ import annotations

import asyncio
import logging
import pickle
import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator
from enum import IntEnum
from typing import Any, Final, cast

logger = logging.getLogger(__name__)

PREFIX: Final = struct.Struct("<IB")
MAX_UNSENT: Final = 8 * 1024 * 1024
"""Maximum number of bytes that wait for an end that does not read, before the pipe is closed."""
DELAY_S: Final = 0.01
"""Maximum time in seconds for which a message waits to be sent with a more urgent one."""


class Kind(IntEnum):
    """Message kinds and their senders."""

    # the edge
    REQUEST = 1
    CANCEL = 2
    RELEASE = 3
    FORGET = 4
    STATS = 5
    # the engine
    FRAME = 16
    FAILURE = 17
    STATE = 18


def encode_message(kind: Kind, *values: Any) -> bytes:
    content = pickle.dumps(values, pickle.HIGHEST_PROTOCOL)
    return PREFIX.pack(len(content), kind) + content


class MessageDecoder:
    """Splits the bytes of a stream into messages."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._wanted_length = 0
        """Length of `_buffer` at which a message may be complete, so that a large one is assembled only once."""

    def feed(self, data: bytes) -> Iterator[tuple[int, tuple[Any, ...]]]:
        """Add data, and yield the kind and values of each complete message."""
        if self._buffer:
            self._buffer += data
            if len(self._buffer) < self._wanted_length:
                return
            data, self._buffer = bytes(self._buffer), bytearray()
        at, end, self._wanted_length = 0, len(data), 0
        while end - at >= PREFIX.size:
            length, kind = PREFIX.unpack_from(data, at)
            begin = at + PREFIX.size
            if end - begin < length:
                self._wanted_length = PREFIX.size + length
                break
            at = begin + length
            yield kind, pickle.loads(data[begin:at])
        self._buffer += data[at:]


class Link(asyncio.Protocol, ABC):
    """One end of a pipe. Subclasses handle messages; `connection_lost` is called once, even if a process crashes."""

    def __init__(self) -> None:
        self._decoder = MessageDecoder()
        self._outgoing: list[bytes] = []
        self._outgoing_bytes = 0
        self._is_flush_scheduled = self._is_flush_delayed = False
        """Whether outgoing messages are about to be written, and whether they will be after a delay."""
        self._loop = asyncio.get_running_loop()
        self._transport: asyncio.Transport | None = None
        self.reason: str | None = None
        """Why this end has closed the pipe, in one sentence."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)

    @abstractmethod
    def handle_message(self, kind: int, values: tuple[Any, ...]) -> None:
        """Handle a message. An exception closes the pipe."""

    def send(self, message: bytes) -> None:
        """Send a message together with all others of this event loop iteration. Dropped if the pipe is closed."""
        if self._enqueue(message) and not self._is_flush_scheduled:
            self._is_flush_scheduled = True
            self._loop.call_soon(self._flush)

    def send_lazily(self, message: bytes) -> None:
        """Send a message with the next urgent one, or after DELAY_S, because each write wakes the other end."""
        if self._enqueue(message) and not (self._is_flush_scheduled or self._is_flush_delayed):
            self._is_flush_delayed = True
            self._loop.call_later(DELAY_S, self._flush_delayed)

    def _enqueue(self, message: bytes) -> bool:
        if self._transport is not None and self._transport.is_closing():
            return False
        self._outgoing.append(message)
        self._outgoing_bytes += len(message)
        return True

    @property
    def unsent_bytes(self) -> int:
        """Number of bytes that the other end has not read yet."""
        return self._outgoing_bytes + (0 if self._transport is None else self._transport.get_write_buffer_size())

    def data_received(self, data: bytes) -> None:
        try:
            for kind, values in self._decoder.feed(data):
                self.handle_message(kind, values)
        except Exception:  # later messages may refer to this one
            logger.exception("A message was not understood")
            self.abort("A message was not understood.")

    def abort(self, reason: str) -> None:
        self.reason = self.reason or reason
        if self._transport is not None:
            self._transport.abort()

    def _flush_delayed(self) -> None:
        self._is_flush_delayed = False
        if not self._is_flush_scheduled:
            self._flush()

    def _flush(self) -> None:
        self._is_flush_scheduled = False
        messages, self._outgoing, self._outgoing_bytes = self._outgoing, [], 0
        if not messages or self._transport is None or self._transport.is_closing():
            return
        self._transport.write(b"".join(messages))
        if self.unsent_bytes > MAX_UNSENT:
            self.abort("The other end does not read.")
