"""How messages follow each other in a pipe: length, kind, content; all numbers are little-endian."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import Final


class Kind(IntEnum):
    """Message kinds and their senders."""

    # the edge
    OPEN = 1
    HELLO = 2
    BYE = 3
    REQUEST = 4
    WITHDRAW = 5
    RELEASE = 6
    STATS = 7
    # the engine
    ARENA = 16
    FRAME = 17
    INLINE = 18
    FAILURE = 19
    STATE = 20


class BadMessage(Exception):
    """The other end sent an invalid message: all that follows is unintelligible."""


PREFIX: Final = struct.Struct("<IB")
MOST_BYTES: Final = 64 * 1024
"""In a message, unless the receiver takes more."""


def framed(kind: Kind, content: bytes) -> bytes:
    """A whole message."""
    return PREFIX.pack(len(content), kind) + content


class Splitter:
    """From the bytes of a stream to messages."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._rest = bytearray()
        self._wanted = 0
        """Length of `_rest` at which a message may be complete: a large one is assembled once."""

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Kind and content of each complete message. Raises BadMessage for one that is too long."""
        if self._rest:
            self._rest += data
            if len(self._rest) < self._wanted:
                return
            data, self._rest = bytes(self._rest), bytearray()
        at, end, self._wanted = 0, len(data), 0
        while end - at >= PREFIX.size:
            length, kind = PREFIX.unpack_from(data, at)
            if length > self._most_bytes:
                raise BadMessage(f"A message of {length} bytes is too long.")
            begin = at + PREFIX.size
            if end - begin < length:
                self._wanted = PREFIX.size + length
                break
            at = begin + length
            yield kind, data[begin:at]
        self._rest += data[at:]
