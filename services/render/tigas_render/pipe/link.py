"""One end of a pipe on the event loop: messages out in batches, messages in one by one, and one sentence at its end.

A message is its content's length and its kind, then the content: a tuple of plain values, pickled. Both ends are of one
version and one user, as one process starts them.
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
MOST_UNSENT: Final = 8 * 1024 * 1024
"""Bytes that may wait for an end that does not read; then it is given up."""
DELAY_S: Final = 0.01
"""Maximum wait of a message that is not urgent for an urgent one."""


class Kind(IntEnum):
    """Message kinds and their senders."""

    # the edge
    REQUEST = 1
    WITHDRAW = 2
    RELEASE = 3
    FORGET = 4
    STATS = 5
    # the engine
    FRAME = 16
    FAILURE = 17
    STATE = 18


def framed(kind: Kind, *values: Any) -> bytes:
    content = pickle.dumps(values, pickle.HIGHEST_PROTOCOL)
    return PREFIX.pack(len(content), kind) + content


class Splitter:
    """From the bytes of a stream to messages."""

    def __init__(self) -> None:
        self._rest = bytearray()
        self._wanted = 0
        """Length of `_rest` at which a message may be complete: a large one is assembled once."""

    def feed(self, data: bytes) -> Iterator[tuple[int, tuple[Any, ...]]]:
        """Kind and values of each complete message."""
        if self._rest:
            self._rest += data
            if len(self._rest) < self._wanted:
                return
            data, self._rest = bytes(self._rest), bytearray()
        at, end, self._wanted = 0, len(data), 0
        while end - at >= PREFIX.size:
            length, kind = PREFIX.unpack_from(data, at)
            begin = at + PREFIX.size
            if end - begin < length:
                self._wanted = PREFIX.size + length
                break
            at = begin + length
            yield kind, pickle.loads(data[begin:at])
        self._rest += data[at:]


class Link(asyncio.Protocol, ABC):
    """A subclass handles messages; `connection_lost` comes once, however the pipe ends."""

    def __init__(self) -> None:
        self._splitter = Splitter()
        self._outgoing: list[bytes] = []
        self._outgoing_bytes = 0
        self._is_leaving = self._is_delayed = False
        """Whether outgoing messages are about to be written, or will be after a pause."""
        self._loop = asyncio.get_running_loop()
        self._transport: asyncio.Transport | None = None
        self.reason: str | None = None
        """Why this end has closed the pipe, in a sentence."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)

    @abstractmethod
    def received(self, kind: int, values: tuple[Any, ...]) -> None:
        """A message. An exception ends the pipe."""

    def send(self, message: bytes) -> None:
        """Send a message with all others of this iteration of the event loop; dropped once the pipe is closed."""
        if self._add(message) and not self._is_leaving:
            self._is_leaving = True
            self._loop.call_soon(self._flush)

    def send_with_next(self, message: bytes) -> None:
        """Send a message with the next that is more urgent, or after a while: each write wakes the other end."""
        if self._add(message) and not (self._is_leaving or self._is_delayed):
            self._is_delayed = True
            self._loop.call_later(DELAY_S, self._flush_delayed)

    def _add(self, message: bytes) -> bool:
        if self._transport is not None and self._transport.is_closing():
            return False
        self._outgoing.append(message)
        self._outgoing_bytes += len(message)
        return True

    @property
    def unsent(self) -> int:
        """Bytes not read by the other end yet."""
        return self._outgoing_bytes + (0 if self._transport is None else self._transport.get_write_buffer_size())

    def data_received(self, data: bytes) -> None:
        try:
            for kind, values in self._splitter.feed(data):
                self.received(kind, values)
        except Exception:  # later messages may refer to this one
            logger.exception("A message was not understood")
            self.abort("A message was not understood.")

    def abort(self, reason: str) -> None:
        self.reason = self.reason or reason
        if self._transport is not None:
            self._transport.abort()

    def _flush_delayed(self) -> None:
        self._is_delayed = False
        if not self._is_leaving:
            self._flush()

    def _flush(self) -> None:
        self._is_leaving = False
        messages, self._outgoing, self._outgoing_bytes = self._outgoing, [], 0
        if not messages or self._transport is None or self._transport.is_closing():
            return
        self._transport.write(b"".join(messages))
        if self.unsent > MOST_UNSENT:
            self.abort("The other end does not read.")
