"""Passes datagrams between the edges of one port, where the kernel does not deliver each to its edge.

A datagram goes to its owner over a Unix socket with the client's address and the time at which it arrived. The owner
answers from its own UDP socket with the same port.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import struct
from collections.abc import Callable, Sequence

from tigas_render.transport.cids import Edge
from tigas_render.transport.gso import Address

logger = logging.getLogger(__name__)

_HEADER = struct.Struct("=dHIIB")
"""Arrival in seconds of the monotonic clock, port, flow and scope (of IPv6), and the length of the host's name."""
MAX_DRAIN = 128
"""Datagrams read before other work gets its turn."""
MAX_MESSAGE = _HEADER.size + 255 + 65_535


class Relay:
    """One edge's side."""

    def __init__(self, edge: Edge, inbox: socket.socket, outboxes: Sequence[socket.socket]) -> None:
        """inbox: receives datagrams for this edge; outboxes: sockets of the edges, by number."""
        self._edge = edge
        self._inbox = inbox
        self._outboxes = outboxes
        for each in (inbox, *outboxes):
            each.setblocking(False)

    def start(self, received: Callable[[bytes, Address, float], None], drained: Callable[[], None]) -> None:
        """Deliver relayed datagrams to `received`, and report when no more are waiting."""
        self._received = received
        self._drained = drained
        asyncio.get_running_loop().add_reader(self._inbox.fileno(), self._read)

    def close(self) -> None:
        """Stop to read, and close the sockets."""
        asyncio.get_running_loop().remove_reader(self._inbox.fileno())
        for each in (self._inbox, *self._outboxes):
            each.close()

    def pass_on(self, data: bytes, address: Address, arrived: float) -> bool:
        """Whether a datagram is another edge's; then it has been sent there, or is lost, as in a network."""
        owner = self._edge.owner(data)
        if owner == self._edge.number:
            return False
        host, port, *rest = address
        flow, scope = rest or (0, 0)
        name = str(host).encode()
        header = _HEADER.pack(arrived, port, flow, scope, len(name))
        try:
            self._outboxes[owner].sendmsg((header, name, data))
        except OSError as error:  # it is full
            logger.debug("A datagram for edge %s is dropped: %s", owner, error)
        return True

    def _read(self) -> None:
        try:
            for _ in range(MAX_DRAIN):
                self._received(*_unpacked(self._inbox.recv(MAX_MESSAGE)))
        except (BlockingIOError, InterruptedError):
            pass
        self._drained()


def _unpacked(message: bytes) -> tuple[bytes, Address, float]:
    arrived, port, flow, scope, length = _HEADER.unpack_from(message)
    begin = _HEADER.size + length
    host = message[_HEADER.size : begin].decode()
    return message[begin:], (host, port, flow, scope) if ":" in host else (host, port), arrived
