"""Shared memory for one edge's frames: the engine writes them, the edge reads and releases them.

A memfd has no name: it disappears with the last process that has it open, however that ends. Its size is sealed, since
shrinking it would crash the other process.
"""

from __future__ import annotations

import fcntl
import mmap
import os
from bisect import bisect_left

GRAIN = 64
"""Allocation granularity in bytes: a processor cache line."""
PASSED = b"\0"
"""The data with which an arena is passed: a descriptor needs some."""


class Arena:
    """The engine's side. The lowest room that fits is taken, so that the same pages are used again and again."""

    def __init__(self, size: int) -> None:
        """size: in bytes; memory is used only as far as frames ever reached."""
        self._fd = os.memfd_create("tigas frames", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.ftruncate(self._fd, size)
            fcntl.fcntl(self._fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
            self._memory = mmap.mmap(self._fd, size)
        except BaseException:
            os.close(self._fd)
            raise
        self._free = [(0, size)]
        """Offset and length, in order; neighbours are merged."""
        self._taken: dict[int, int] = {}
        """Length by offset."""

    @property
    def fd(self) -> int:
        """To be passed to the edge, until `close`."""
        return self._fd

    @property
    def used(self) -> int:
        """Bytes that are taken."""
        return sum(self._taken.values())

    def write(self, body: bytes | memoryview) -> int | None:
        """Copy a frame to free space; its offset, or None if there is no space."""
        length = max(GRAIN, -(-len(body) // GRAIN) * GRAIN)
        position = next((position for position, (_, room) in enumerate(self._free) if room >= length), None)
        if position is None:
            return None
        offset, room = self._free.pop(position)
        if room > length:
            self._free.insert(position, (offset + length, room - length))
        self._taken[offset] = length
        self._memory[offset : offset + len(body)] = body
        return offset

    def free(self, offset: int) -> None:
        """Take a frame's room back. Raises KeyError if none was written there."""
        length = self._taken.pop(offset)
        position = bisect_left(self._free, (offset, length))
        if position < len(self._free) and self._free[position][0] == offset + length:
            length += self._free.pop(position)[1]
        if position and sum(self._free[position - 1]) == offset:
            position -= 1
            offset, length = self._free[position][0], self._free[position][1] + length
            self._free[position] = (offset, length)
        else:
            self._free.insert(position, (offset, length))

    def close(self) -> None:
        """Give the memory back, once; the edge keeps its own mapping until it ends."""
        if not self._memory.closed:
            self._memory.close()
            os.close(self._fd)


def map_arena(fd: int) -> memoryview:
    """The edge's side: all of an arena, to be read only; the descriptor is closed. Raises ValueError and OSError."""
    try:
        return memoryview(mmap.mmap(fd, 0, prot=mmap.PROT_READ))
    finally:
        os.close(fd)
