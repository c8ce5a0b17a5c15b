"""The number of connections of each edge, in memory that all edges share.

New clients fall on edges at random, and the fullest edge is the first that is too busy. So an edge with more
connections than another sends new clients there, by a Retry.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

MOST_AHEAD: Final = 1
"""Connections that an edge may have beyond another's and still take new clients: a Retry costs them a round trip."""
BYTES: Final = 4
"""Of a count, which is read and written as a whole."""


@contextmanager
def counts_file(edges: int) -> Iterator[int]:
    """The memory for some edges' counts, as a file descriptor without a name, until the context ends."""
    fd = os.memfd_create("tigas edges", os.MFD_CLOEXEC)
    try:
        os.ftruncate(fd, BYTES * edges)
        yield fd
    finally:
        os.close(fd)


class EdgeCounts:
    """One edge's view of the counts."""

    def __init__(self, fd: int, number: int, edges: int) -> None:
        """fd: from `counts_file`; it is not needed afterwards. number: of this edge, which begins without connections;
        edges: the number of all.
        """
        self._number = number
        self._counts = memoryview(mmap.mmap(fd, BYTES * edges)).cast("I")
        self.update(0)

    def update(self, connections: int) -> None:
        """Tell the others the number of this edge's connections."""
        self._counts[self._number] = connections

    def emptier(self) -> int | None:
        """The number of the edge with the fewest connections, if this one should send new clients there."""
        counts = self._counts.tolist()
        fewest = min(counts)
        return None if counts[self._number] <= fewest + MOST_AHEAD else counts.index(fewest)
