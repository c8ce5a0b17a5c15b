"""Arrival time of a datagram: the kernel's timestamp (SO_TIMESTAMPNS, socket(7)) on the monotonic clock.

Under load a datagram waits in the socket longer than anywhere else, and deadlines include that time.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Sequence

SO_TIMESTAMPNS = 35
"""Linux'; the control message has the same number."""
_TIMESPEC = struct.Struct("@ll")
STAMP_SPACE = socket.CMSG_SPACE(_TIMESPEC.size)
"""Bytes of room for the stamp."""


def ask_for_stamps(sock: socket.socket) -> None:
    """Enable the kernel's timestamps, where available."""
    with contextlib.suppress(OSError):
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)


def stamp_ns(ancillary: Sequence[tuple[int, int, bytes]]) -> int | None:
    """The stamp in a datagram's control messages, in nanoseconds of the real-time clock."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS) and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            return int(seconds) * 1_000_000_000 + int(nanoseconds)
    return None


def arrival(stamp: int | None, real_ns: int, now: float, empty_at: float) -> float:
    """Arrival of a datagram, in seconds of the monotonic clock.

    real_ns, now: the two clocks, read together. empty_at: when the socket was last seen empty, a lower bound for
    anything read now, whatever steps the real-time clock has taken since.
    """
    if stamp is None:
        return now
    return min(now, max(empty_at, now - (real_ns - stamp) / 1e9))
