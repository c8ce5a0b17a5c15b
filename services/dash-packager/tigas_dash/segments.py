"""Segments that can be read while they grow."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from tigas_dash.errors import ExpiredSegment, UnknownSegment

MAX_AHEAD = 2
"""A request for a segment up to this far ahead waits; requests for later ones are refused."""


class SegmentWindow:
    """The last segments of one representation, numbered from 1. Any number of readers can follow the growing one."""

    def __init__(self, keep: int) -> None:
        """Keeps `keep` complete segments in addition to the growing one."""
        self._keep = keep
        self._chunks: dict[int, list[bytes]] = {}
        """Chunks by segment, including segments requested slightly early."""
        self._growing = 0
        self._closed = False
        self._changed = asyncio.Event()

    def append(self, number: int, chunk: bytes) -> None:
        """Add a chunk to segment `number`; a new number completes the previous segment."""
        self._growing = number
        for old in [old for old in self._chunks if old < number - self._keep]:
            del self._chunks[old]
        self._chunks.setdefault(number, []).append(chunk)
        self._notify()

    def close(self) -> None:
        """End all readers along with the stream."""
        self._closed = True
        self._notify()

    def read(self, number: int) -> AsyncIterator[bytes]:
        """The chunks of a segment, each as soon as it exists.

        Raises ExpiredSegment, and UnknownSegment if it is too far ahead.
        """
        if number < 1 or number > self._growing + MAX_AHEAD or self._closed:
            raise UnknownSegment(f"There is no segment {number}; the newest is {self._growing}.")
        if number not in self._chunks and number <= self._growing:
            raise ExpiredSegment(f"Segment {number} has expired; the newest is {self._growing}.")
        return self._follow(number, self._chunks.setdefault(number, []))

    async def _follow(self, number: int, chunks: list[bytes]) -> AsyncIterator[bytes]:
        sent = 0
        while True:
            changed = self._changed
            if sent < len(chunks):
                ready = b"".join(chunks[sent:])
                sent = len(chunks)
                yield ready
            elif number < self._growing or self._closed:
                return
            else:
                await changed.wait()

    def _notify(self) -> None:
        # Current waiters hold the old event; later ones get the new event.
        self._changed.set()
        self._changed = asyncio.Event()
