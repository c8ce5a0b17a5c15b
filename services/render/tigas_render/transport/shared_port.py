"""One UDP port shared by several edges (SO_REUSEPORT): the owner of each datagram, and the secrets that edges share.

The first byte of a connection id, modulo the number of edges, identifies its edge, so that datagrams from any address
find it. A client's first packet has a random connection id, and so goes to a random edge.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import socket
import struct
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from aioquic.tls import SessionTicket

LONG_HEADER = 0x80
LONG_HEADER_CID = 1 + 4 + 1
"""Offset of the destination connection id, after a long header's first byte, version and length (RFC 8999, 5.1)."""
SHORT_HEADER_CID = 1

SO_ATTACH_REUSEPORT_CBPF = 51
LOAD_BYTE, JUMP, JUMP_IF_SET, MODULO, RETURN = 0x30, 0x05, 0x45, 0x94, 0x16

MAX_TICKETS = 1024

MAX_LEAD = 1
"""Tolerated lead in connections over another edge before new clients are sent there: a Retry costs a round trip."""
COUNT_BYTES = 4
"""Size of a count, which is read and written atomically."""


@dataclass(frozen=True, slots=True)
class Edge:
    """One of the processes that share a port; by default the only one."""

    number: int = 0
    total: int = 1

    def mark_cid(self, cid: bytes) -> bytes:
        """Return the connection id, changed to identify this edge."""
        first = cid[0] - cid[0] % self.total + self.number
        return bytes((first if first < 256 else first - self.total,)) + cid[1:]


def attach_steering(sock: socket.socket, edges: int) -> bool:
    """Make the kernel deliver each datagram to its edge, by a classic BPF program (bpf(4), socket(7)).

    A port's sockets are numbered in the order in which they were bound. Returns False if the kernel does not support
    this (Linux before 4.5, gVisor).
    """
    program = b"".join(
        struct.pack("@HBBI", *instruction)
        for instruction in (
            (LOAD_BYTE, 0, 0, 0),
            (JUMP_IF_SET, 0, 2, LONG_HEADER),
            (LOAD_BYTE, 0, 0, LONG_HEADER_CID),
            (JUMP, 0, 0, 1),
            (LOAD_BYTE, 0, 0, SHORT_HEADER_CID),
            (MODULO, 0, 0, edges),
            (RETURN, 0, 0, 0),
        )
    )
    buffer = ctypes.create_string_buffer(program, len(program))
    option = struct.pack("@HP", len(program) // 8, ctypes.addressof(buffer))
    try:
        sock.setsockopt(socket.SOL_SOCKET, SO_ATTACH_REUSEPORT_CBPF, option)
    except OSError:
        return False
    return True


@contextmanager
def open_counts_file(edges: int) -> Iterator[int]:
    """Shared memory for the counts of all edges, as a context manager that yields its file descriptor."""
    fd = os.memfd_create("tigas edges", os.MFD_CLOEXEC)
    try:
        os.ftruncate(fd, COUNT_BYTES * edges)
        yield fd
    finally:
        os.close(fd)


class EdgeCounts:
    """One edge's view of the number of connections of every edge.

    New clients reach edges at random, and the fullest edge is the first to be overloaded. An edge with more connections
    than another therefore sends new clients there, with a Retry.
    """

    def __init__(self, fd: int, number: int, edges: int) -> None:
        """fd: from `open_counts_file`, not needed afterwards. number: this edge's, starting at 0 connections. edges:
        the total number of edges.
        """
        self._number = number
        self._counts = memoryview(mmap.mmap(fd, COUNT_BYTES * edges)).cast("I")
        self.update(0)

    def update(self, connections: int) -> None:
        """Publish the number of this edge's connections."""
        self._counts[self._number] = connections

    def less_loaded_edge(self) -> int | None:
        """The number of the edge with the fewest connections, if this one should send new clients there."""
        counts = self._counts.tolist()
        fewest = min(counts)
        return None if counts[self._number] <= fewest + MAX_LEAD else counts.index(fewest)


class TicketStore:
    """The newest session tickets, which let a returning client send a request with its first packet (0-RTT).

    Each ticket is valid for one resumption, so that a recorded first flight cannot be replayed.
    """

    def __init__(self, capacity: int = MAX_TICKETS) -> None:
        self._capacity = capacity
        self._tickets: OrderedDict[bytes, SessionTicket] = OrderedDict()

    def __iter__(self) -> Iterator[SessionTicket]:
        return iter(self._tickets.values())

    def add(self, ticket: SessionTicket) -> None:
        """Store an issued ticket, dropping the oldest one if the store is full."""
        self._tickets[ticket.ticket] = ticket
        while len(self._tickets) > self._capacity:
            self._tickets.popitem(last=False)

    def pop(self, label: bytes) -> SessionTicket | None:
        """Remove and return the ticket that a client presents; None if it is unknown or used."""
        return self._tickets.pop(label, None)


@dataclass(frozen=True, slots=True)
class PortShare:
    """One edge's share of the port; by default the whole of it."""

    edge: Edge = Edge()
    sockets: tuple[socket.socket, ...] = ()
    """Bound sockets, one for each address family, which the edge closes. If empty, the server binds its own."""
    retry_key: bytes | None = None
    """The same key for all edges, so that each accepts the others' tokens."""
    tickets: TicketStore = field(default_factory=TicketStore)
    """Session tickets of all edges."""
    counts: EdgeCounts | None = None
    """Number of connections of all edges; None if new clients stay at the edge that they reach."""
