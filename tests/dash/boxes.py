"""Reads ISO base media file format boxes, by the standard and not by the code that writes them."""

from __future__ import annotations

import struct
from collections.abc import Iterator

CONTAINERS = {b"moov", b"trak", b"mdia", b"minf", b"dinf", b"stbl", b"mvex", b"moof", b"traf"}


def walk(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Every box with its content, from the outside in. Raises AssertionError where lengths do not fit."""
    at = 0
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        assert 8 <= size <= len(data) - at, f"{kind!r} has {size} bytes of {len(data) - at}"
        yield kind, data[at + 8 : at + size]
        if kind in CONTAINERS:
            yield from walk(data[at + 8 : at + size])
        at += size


def contents(data: bytes, kind: bytes) -> list[bytes]:
    """The content of all boxes of a kind."""
    return [content for found, content in walk(data) if found == kind]
