"""Shared memory for the frames of one edge: the engine writes them, and the edge reads and releases them.

A memfd has no name, so it disappears with the last process that has it open, even after a crash. Its size is sealed,
because shrinking it would crash the other process.
"""

from __future__ import annotations

import fcntl
import mmap
import os
from bisect import bisect_left

ALIGNMENT = 64
"""Allocation granularity in bytes, the size of a cache line."""
FD_MESSAGE = b"\0"
"""Data to send along with an arena's file descriptor, which cannot be sent alone."""


class Arena:
    """The engine's side. Frames get the lowest free space that fits, so that the same pages are reused."""

    def __init__(self, size: int) -> None:
        """size: in bytes. Memory is used only up to the highest address of any frame so far."""
        self._fd = os.memfd_create("tigas frames", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            os.ftruncate(self._fd, size)
            fcntl.fcntl(self._fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
            self._memory = mmap.mmap(self._fd, size)
        except BaseException:
            os.close(self._fd)
            raise
        self._free = [(0, size)]
        """Offsets and lengths of free space, in order, with neighbours merged."""
        self._allocated: dict[int, int] = {}
        """Lengths of used space by offset."""

    @property
    def fd(self) -> int:
        """The file descriptor to pass to the edge, valid until `close`."""
        return self._fd

    @property
    def used_bytes(self) -> int:
        """Number of bytes in use."""
        return sum(self._allocated.values())

    def write(self, body: bytes | memoryview) -> int | None:
        """Copy a frame to free space. Returns its offset, or None if there is not enough space."""
        length = max(ALIGNMENT, -(-len(body) // ALIGNMENT) * ALIGNMENT)
        position = next((position for position, (_, room) in enumerate(self._free) if room >= length), None)
        if position is None:
            return None
        offset, room = self._free.pop(position)
        if room > length:
            self._free.insert(position, (offset + length, room - length))
        self._allocated[offset] = length
        self._memory[offset : offset + len(body)] = body
        return offset

    def free(self, offset: int) -> None:
        """Free a frame's space. Raises KeyError if there is no frame at the offset."""
        length = self._allocated.pop(offset)
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
        """Release the memory. The edge keeps its own mapping until it exits. Further calls have no effect."""
        if not self._memory.closed:
            self._memory.close()
            os.close(self._fd)


def map_arena(fd: int) -> memoryview:
    """The edge's side: map a whole arena read-only, and close the descriptor. Raises ValueError and OSError."""
    try:
        return memoryview(mmap.mmap(fd, 0, prot=mmap.PROT_READ))
    finally:
        os.close(fd)
