"""Connection ids that name the owning edge of a connection, so that datagrams from any address find it.

Several processes may share a port (SO_REUSEPORT). The first byte of a connection id, modulo their number, is the owner;
a client's first packet has a random id, and so opens a connection at the edge named by it.
"""

from __future__ import annotations

from dataclasses import dataclass

LONG_HEADER_CID = 1 + 4 + 1
"""Where the destination connection id begins behind a long header's first byte, version and length (RFC 8999, 5.1)."""
SHORT_HEADER_CID = 1


@dataclass(frozen=True, slots=True)
class Edge:
    """One of the processes that share a port; alone by default."""

    number: int = 0
    of: int = 1

    def named(self, cid: bytes) -> bytes:
        """The connection id, changed so that it names this edge."""
        first = cid[0] - cid[0] % self.of + self.number
        return bytes((first if first < 256 else first - self.of,)) + cid[1:]

    def owner(self, datagram: bytes) -> int:
        """The number of the edge that a datagram is for; this one's if it does not say."""
        at = LONG_HEADER_CID if datagram and datagram[0] & 0x80 else SHORT_HEADER_CID
        return datagram[at] % self.of if len(datagram) > at else self.number


ALONE = Edge()
"""The only one of its port."""
