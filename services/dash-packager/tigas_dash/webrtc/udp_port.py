"""One UDP port for all viewers: each datagram is dispatched to its connection.

aioice binds a port for each connection, each of which a router would have to forward. Here, a STUN binding request
identifies its connection by the user fragment (RFC 8445, 7.2.2), and from then on its source address belongs to that
connection. The only candidate is this port under the host that the viewer requested, and viewers' own candidates are
ignored: a viewer that reaches this port is a peer-reflexive candidate, and packets return the way they came.
"""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing, suppress
from typing import Any

from aioice import Candidate, Connection, stun
from aioice.candidate import candidate_foundation, candidate_priority
from aioice.ice import StunProtocol

from tigas_common.address import Address
from tigas_common.udp import Address as SocketAddress
from tigas_common.udp import UdpEndpoint, bind

Peer = tuple[str, int]
MAX_PEERS = 16
"""Maximum number of addresses per connection: a browser tries each of its machine's networks."""


class UdpPort:
    """The port, opened by `listen`."""

    def __init__(self, sock: socket.socket) -> None:
        self.host: str
        self.number: int
        self.host, self.number = sock.getsockname()[:2]
        self._by_username: dict[str, PortTransport] = {}
        self._by_peer: dict[Peer, PortTransport] = {}
        self._endpoint = UdpEndpoint(sock, self.datagram_received, lambda: None)

    @classmethod
    @asynccontextmanager
    async def listen(cls, address: Address) -> AsyncIterator[UdpPort]:
        """Listen, as a context manager. Raises OSError."""
        port = cls(bind(address.host, address.port))
        with closing(port._endpoint):
            yield port

    def attach(
        self, connection: Connection, received: Callable[[], None], sent: Callable[[int], None]
    ) -> PortTransport:
        """Make a connection that has not gathered candidates use this port instead of its own.

        `received` is called for each datagram from the viewer, and `sent` with the size of each datagram to it.
        """
        lane = PortTransport(self, connection, received, sent)
        lane.local_candidate = self.candidate(self.host)
        self._by_username[connection.local_username] = lane

        async def candidates(component: int, addresses: list[str], *_: object) -> list[Candidate]:
            connection._protocols.append(lane)
            return [lane.local_candidate]

        connection.get_component_candidates = candidates  # type: ignore[assignment, method-assign]
        return lane

    def candidate(self, host: str) -> Candidate:
        """This port as a candidate for a viewer that reaches it under `host`, an address or a name."""
        if host == "localhost" or host.endswith(".localhost"):
            # a port on all addresses also accepts IPv4, which every machine has
            host = "::1" if ":" in self.host and self.host != "::" else "127.0.0.1"
        return Candidate(
            foundation=candidate_foundation("host", "udp", host),
            component=1,
            transport="udp",
            priority=candidate_priority(1, "host"),
            host=host,
            port=self.number,
            type="host",
        )

    def datagram_received(self, data: bytes, address: SocketAddress, _arrived: float) -> None:
        """Dispatch a datagram; unknown ones are dropped."""
        peer = (address[0], address[1])
        lane = self._by_username.get(name) if (name := _stun_username(data)) is not None else self._by_peer.get(peer)
        if lane is None:
            return
        if self._by_peer.get(peer) is not lane:
            self._by_peer[peer] = lane
            if len(lane.addresses) == MAX_PEERS:
                del lane.addresses[oldest := next(iter(lane.addresses))]
                if self._by_peer.get(oldest) is lane:
                    del self._by_peer[oldest]
            lane.addresses[peer] = address
        lane.handle_datagram(data, peer)

    def send(self, data: bytes, address: SocketAddress) -> None:
        """Send a datagram, unless the port is closed."""
        self._endpoint.send([(data, address)])

    def detach(self, lane: PortTransport) -> None:
        """Forget a lane whose connection has ended."""
        self._by_username = {name: each for name, each in self._by_username.items() if each is not lane}
        self._by_peer = {peer: each for peer, each in self._by_peer.items() if each is not lane}


class PortTransport(StunProtocol):
    """A connection's share of the port, which aioice uses like a socket."""

    def __init__(
        self, port: UdpPort, connection: Connection, received: Callable[[], None], sent: Callable[[int], None]
    ) -> None:
        super().__init__(connection)
        self._port = port
        self._received = received
        self._sent = sent
        self.addresses: dict[Peer, SocketAddress] = {}
        """Addresses of its viewer, oldest first."""
        self.first_rtp_timestamp: int | None = None
        """Timestamp of the first RTP packet sent, readable as SRTP does not encrypt headers (RFC 3711, 3.1)."""
        self.connection_made(_SendTransport(self))

    def handle_datagram(self, data: bytes, peer: Peer) -> None:
        self._received()
        with suppress(ValueError, KeyError, IndexError, struct.error):  # aioice catches only some malformed packets
            self.datagram_received(data, peer)

    def sendto(self, data: bytes, peer: Peer) -> None:
        """Send a datagram from the port."""
        if self.first_rtp_timestamp is None and _is_rtp(data):
            (self.first_rtp_timestamp,) = struct.unpack_from("!I", data, 4)
        self._sent(len(data))
        self._port.send(data, self.addresses.get(peer, peer))

    def detach(self) -> None:
        """Leave the port, which stays open, at the end of the connection."""
        self._port.detach(self)
        self.connection_lost(None)


class _SendTransport(asyncio.DatagramTransport):
    """The sending side of a lane's protocol."""

    def __init__(self, lane: PortTransport) -> None:
        super().__init__()
        self._lane = lane

    def sendto(self, data: Any, addr: Any = None) -> None:
        self._lane.sendto(data, addr)

    def close(self) -> None:
        self._lane.detach()


def _stun_username(data: bytes) -> str | None:
    """The user fragment requested by a STUN binding request; None for any other datagram."""
    if len(data) < stun.HEADER_LENGTH or data[:2] != b"\x00\x01":
        return None
    try:
        username = stun.parse_message(data).attributes.get("USERNAME")
    except (ValueError, struct.error, IndexError):
        return None
    return username.partition(":")[0] if isinstance(username, str) else None


def _is_rtp(data: bytes) -> bool:
    """Whether a datagram is RTP, and not RTCP, DTLS or STUN (RFC 5761, 4; RFC 7983, 7)."""
    return len(data) >= 12 and 128 <= data[0] < 192 and not 192 <= data[1] <= 223
