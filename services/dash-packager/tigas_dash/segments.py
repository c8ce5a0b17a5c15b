"""Segments that are read while they grow."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from tigas_dash.errors import ExpiredSegment, UnknownSegment

AHEAD = 2
"""A request for a segment this far ahead waits; one for a later segment is refused."""


class Segment:
    """A media segment: chunks are appended until it is complete; any number of readers follow."""

    def __init__(self) -> None:
        self._chunks: list[bytes] = []
        self._complete = False
        self._changed = asyncio.Event()

    def append(self, chunk: bytes) -> None:
        """One more chunk."""
        self._chunks.append(chunk)
        self._wake()

    def complete(self) -> None:
        """There are no more chunks: readers end."""
        self._complete = True
        self._wake()

    async def read(self) -> AsyncIterator[bytes]:
        """The chunks from the first, each as soon as it exists."""
        sent = 0
        while True:
            changed = self._changed
            if sent < len(self._chunks):
                ready = b"".join(self._chunks[sent:])
                sent = len(self._chunks)
                yield ready
            elif self._complete:
                return
            else:
                await changed.wait()

    def _wake(self) -> None:
        # Present waiters hold the old event; later ones get the new event.
        self._changed.set()
        self._changed = asyncio.Event()


class SegmentWindow:
    """The last segments of one representation, numbered from 1, and those requested slightly early."""

    def __init__(self, keep: int) -> None:
        """Keeps `keep` complete segments in addition to the growing one."""
        self._keep = keep
        self._segments: dict[int, Segment] = {}
        self._growing = 0
        self._closed = False

    def append(self, number: int, chunk: bytes) -> None:
        """Add a chunk to segment `number`; a new number completes the previous segment."""
        if number != self._growing:
            if self._growing:
                self._segments[self._growing].complete()
            self._growing = number
            for old in [old for old in self._segments if old < number - self._keep]:
                del self._segments[old]
        self._segment(number).append(chunk)

    def close(self) -> None:
        """The stream has ended: all readers end."""
        self._closed = True
        for segment in self._segments.values():
            segment.complete()

    def read(self, number: int) -> AsyncIterator[bytes]:
        """The chunks of a segment. Raises ExpiredSegment, and UnknownSegment if it is too far ahead."""
        if number < 1 or number > self._growing + AHEAD or self._closed:
            raise UnknownSegment(f"There is no segment {number}; the newest is {self._growing}.")
        if number not in self._segments and number <= self._growing:
            raise ExpiredSegment(f"Segment {number} is kept no longer; the newest is {self._growing}.")
        return self._segment(number).read()

    def _segment(self, number: int) -> Segment:
        return self._segments.setdefault(number, Segment())
