"""A viewer's UDP socket: reads whole batches if the kernel keeps them together (UDP_GRO)."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Iterator

from tigas_render.transport.udp import STAMP_SPACE, Address, arrival, ask_for_stamps, stamp_ns

SOL_UDP, UDP_GRO = 17, 104
SO_RCVBUFFORCE, SO_RXQ_OVFL = 33, 40
NUMBER = struct.Struct("=i")
SPACE = STAMP_SPACE + 2 * socket.CMSG_SPACE(NUMBER.size)
MAX_DATAGRAM = 65_535
MAX_READS = 16
"""Batches that one viewer reads before others have their turn."""
BUFFER = 4 << 20
"""Requested receive buffer in bytes."""


class ViewerSocket:
    """Connected to one server."""

    def __init__(self, server: tuple[str, int], source: str | None) -> None:
        """source: an address of this machine, or None for its own. Raises OSError."""
        family, _, _, _, address = socket.getaddrinfo(*server, type=socket.SOCK_DGRAM)[0]
        self.server: Address = address
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._empty_at = time.monotonic()
        self.dropped = 0
        """Datagrams that the kernel had no room for, because they were not read soon enough."""
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            ask_for_stamps(self._socket)
            for level, option, value in (
                (socket.SOL_SOCKET, SO_RCVBUFFORCE, BUFFER),  # needs CAP_NET_ADMIN
                (socket.SOL_SOCKET, SO_RXQ_OVFL, 1),
                (SOL_UDP, UDP_GRO, 1),
            ):
                with contextlib.suppress(OSError):  # an old kernel
                    self._socket.setsockopt(level, option, value)
            if source is not None:
                self._socket.bind((source, 0))
            self._socket.connect(self.server)
        except BaseException:
            self._socket.close()
            raise

    def fileno(self) -> int:
        """For the event loop."""
        return self._socket.fileno()

    def read(self) -> Iterator[tuple[bytes, float]]:
        """The datagrams that wait, and when each arrived, in seconds of the monotonic clock.

        Raises ConnectionError if the server's port is closed.
        """
        for _ in range(MAX_READS):
            try:
                data, ancillary, _, _ = self._socket.recvmsg(MAX_DATAGRAM, SPACE)
            except BlockingIOError:
                self._empty_at = time.monotonic()
                return
            arrived = arrival(stamp_ns(ancillary), time.time_ns(), time.monotonic(), self._empty_at)
            size = _number(ancillary, SOL_UDP, UDP_GRO) or len(data)
            self.dropped = _number(ancillary, socket.SOL_SOCKET, SO_RXQ_OVFL) or self.dropped
            for start in range(0, len(data), size):
                yield data[start : start + size], arrived

    def send(self, data: bytes) -> None:
        """Send, or drop if the kernel has no room, which QUIC treats as loss. Raises ConnectionError."""
        with contextlib.suppress(BlockingIOError):
            self._socket.send(data)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _number(ancillary: list[tuple[int, int, bytes]], level: int, kind: int) -> int:
    """The value of a control message, such as the segment size of a batch; 0 without one."""
    for its_level, its_kind, data in ancillary:
        if (its_level, its_kind) == (level, kind):
            return int(NUMBER.unpack_from(data)[0])
    return 0
