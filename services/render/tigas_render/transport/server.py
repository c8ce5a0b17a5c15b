"""The HTTP/3 server: its UDP sockets, connections and certificate."""

from __future__ import annotations

import asyncio
import os
import time
from collections import Counter
from collections.abc import Mapping
from functools import partial
from typing import Self

from aioquic._buffer import Buffer
from aioquic.h3.connection import H3_ALPN
from aioquic.quic.configuration import SMALLEST_MAX_DATAGRAM_SIZE, QuicConfiguration
from aioquic.quic.packet import QuicHeader, QuicPacketType, encode_quic_version_negotiation, pull_quic_header
from starlette.types import ASGIApp

from tigas_common.address import client_network
from tigas_common.origins import OriginPolicy
from tigas_common.udp import Address, Datagram, UdpEndpoint, bind_all
from tigas_common.wire.render import CongestionControl
from tigas_render.admission.connections import ConnectionAdmission, Usage
from tigas_render.admission.limits import Limits
from tigas_render.admission.load import Load
from tigas_render.transport.aioquic_ext.congestion import RENO
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.aioquic_ext.westwood import WESTWOOD
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.connection import Connection, Connections
from tigas_render.transport.frames import SessionFactory
from tigas_render.transport.inbox import Inbox, ReceivedDatagram
from tigas_render.transport.routing import Router, Service
from tigas_render.transport.shared_port import LONG_HEADER, Edge, PortShare
from tigas_render.transport.stateless import RetryPackets, StatelessResets, refusal_packet

MAX_DATAGRAM_SIZE = 1452
"""Bytes of UDP payload that fit in an Ethernet frame over IPv6 (1500 − 40 − 8), and over IPv4."""
CID_LENGTH = 8
TIME_SLICE_S = 0.001
"""Seconds spent on handling datagrams at a time; the resulting work may take several times as long."""
ROUND_DIVISOR = 8
"""With several addresses, a round handles at least one datagram of each address, and about an eighth of its waiting
ones. So no address holds up the others, and hundreds of viewers behind one gateway do not need a round each.
"""


class Http3Server:
    """An HTTP/3 server of an ASGI application and WebTransport sessions; an async context manager."""

    def __init__(
        self,
        app: ASGIApp,
        *,
        certificate: Certificate,
        host: str = "localhost",
        port: int = 0,
        webtransport: Mapping[str, SessionFactory] | None = None,
        limits: Limits | None = None,
        congestion_control: CongestionControl = "westwood",
        reset_key: bytes | None = None,
        origins: OriginPolicy | None = None,
        share: PortShare | None = None,
        load: Load | None = None,
    ) -> None:
        """host: `::` for all addresses of both families. port: 0 for any free port. reset_key: with the key and port of
        an earlier server, that server's clients learn that it has ended. origins: the pages that may open sessions;
        HTTP requests are checked by `app`. share: one edge's share of a port that is already bound. load: measured by
        the caller.
        """
        self._share = share or PortShare()
        self._limits = limits or Limits()
        self._load = load or Load()
        self._congestion_control = {"reno": RENO, "westwood": WESTWOOD}[congestion_control]
        self._service = Service(app, dict(webtransport or {}), self._limits, self._load, origins or OriginPolicy())
        self._configuration = self._configure(certificate)
        self._retries = RetryPackets(self._share.retry_key)
        self._reset_key = reset_key or os.urandom(32)
        self._connections = Connections(self._send, self._publish_count)
        self._admission = ConnectionAdmission(self._limits, self._load)
        self._inbox = Inbox()
        self._next_turns: asyncio.Handle | None = None
        self._endpoints: dict[int, UdpEndpoint] = {}
        """Sockets by the length of their address tuples, which differs between IPv4 and IPv6."""
        self._address: tuple[str, int] = (host, port)
        self._closing = False

    async def __aenter__(self) -> Self:
        """Bind the sockets and start serving. Raises OSError if the address cannot be bound."""
        for sock in self._share.sockets or bind_all(*self._address):
            self._address = sock.getsockname()[:2]
            self._endpoints[len(sock.getsockname())] = UdpEndpoint(
                sock, self._inbox.add, self._on_datagrams, self._load.count_refused_batch
            )
        self._resets = StatelessResets(self._reset_key, self.port)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Refuse new requests, give running ones time to finish (`Limits.grace`), and close all connections."""
        if not self._endpoints:
            return
        self._closing = True
        connections = list(self._connections)
        routers = [connection.router for connection in connections if connection.router is not None]
        for router in routers:
            router.go_away()
        if routers:
            unfinished = [asyncio.create_task(router.drain()) for router in routers]
            _, late = await asyncio.wait(unfinished, timeout=self._limits.grace)
            for task in late:
                task.cancel()
        for connection in connections:
            connection.close()
        await asyncio.gather(*(router.cancel_tasks() for router in routers))
        for connection in connections:
            connection.abandon()
            self._connections.remove(connection)
        for endpoint in self._endpoints.values():
            endpoint.close()
        self._endpoints.clear()
        if self._next_turns is not None:
            self._next_turns.cancel()

    @property
    def port(self) -> int:
        """The UDP port of the server."""
        return self._address[1]

    @property
    def connections(self) -> int:
        return len(self._connections)

    def replace_certificate(self, certificate: Certificate) -> None:
        """Use another certificate for new connections; existing ones continue."""
        self._configuration = self._configure(certificate)

    def _configure(self, certificate: Certificate) -> QuicConfiguration:
        return QuicConfiguration(
            is_client=False,
            alpn_protocols=H3_ALPN,
            certificate=certificate.x509,
            private_key=certificate.private_key,
            congestion_control_algorithm=self._congestion_control,
            connection_id_length=CID_LENGTH,
            idle_timeout=self._limits.idle_timeout,
            max_datagram_size=MAX_DATAGRAM_SIZE,
            max_datagram_frame_size=65_536,
            max_stream_data=self._limits.stream_window,
        )

    def _publish_count(self, connections: int) -> None:
        if self._share.counts is not None:
            self._share.counts.update(connections)

    def _send(self, datagrams: list[Datagram]) -> None:
        if datagrams and (endpoint := self._endpoints.get(len(datagrams[0][1]))) is not None:
            endpoint.send(datagrams)

    def _on_datagrams(self) -> None:
        if self._next_turns is None:
            self._process_inbox()

    def _process_inbox(self) -> None:
        """Handle received datagrams for a time slice; the rest once the event loop has done the resulting work."""
        self._next_turns = None
        until = (now := time.monotonic()) + TIME_SLICE_S
        handled: Counter[str] = Counter()
        had_enough: set[str] = set()
        while now < until and (taken := self._inbox.pop(had_enough)) is not None:
            network, datagram = taken
            if self._load.accept_datagram(now - datagram.arrived):
                self._handle_datagram(datagram)
            handled[network] += 1
            if handled[network] > self._inbox.count(network) // ROUND_DIVISOR and len(self._connections.usage) > 1:
                had_enough.add(network)
            begun, now = now, time.monotonic()
            self._inbox.charge(network, now - begun)
        dirty, self._connections.dirty = self._connections.dirty, set()
        for connection in dirty:
            connection.transmit()
        if self._inbox:
            self._next_turns = asyncio.get_running_loop().call_soon(self._process_inbox)

    def _handle_datagram(self, datagram: ReceivedDatagram) -> None:
        found = self._connection_for(datagram.data, datagram.address)
        if isinstance(found, Connection):
            self._connections.dirty.add(found)
            found.receive(*datagram)
        elif found is not None:
            self._send([(found, datagram.address)])

    def _connection_for(self, data: bytes, address: Address) -> Connection | bytes | None:
        """The existing or new connection of a datagram; a stateless answer to it; or None to drop it."""
        if len(data) <= CID_LENGTH:
            return None
        if not data[0] & LONG_HEADER:  # new connections begin with a long header
            cid = data[1 : 1 + CID_LENGTH]
            known = self._connections.by_cid.get(cid)
            return known or self._resets.create(len(data), cid, asyncio.get_running_loop().time())
        try:
            header = pull_quic_header(Buffer(data=data), host_cid_length=CID_LENGTH)
        except ValueError:
            return None
        if (connection := self._connections.by_cid.get(header.destination_cid)) is not None:
            return connection
        if header.packet_type == QuicPacketType.VERSION_NEGOTIATION or len(data) < SMALLEST_MAX_DATAGRAM_SIZE:
            return None
        if header.version not in self._configuration.supported_versions:
            return encode_quic_version_negotiation(
                source_cid=header.destination_cid,
                destination_cid=header.source_cid,
                supported_versions=self._configuration.supported_versions,
            )
        if header.packet_type != QuicPacketType.INITIAL or self._closing:
            return None
        return self._open_connection(header, address)

    def _open_connection(self, header: QuicHeader, address: Address) -> Connection | bytes | None:
        """Like `_connection_for`, for the first packet of a connection."""
        original, retry_source = header.destination_cid, None
        now = asyncio.get_running_loop().time()
        network = client_network(str(address[0]))
        usage = self._connections.usage.get(network) or Usage(network)
        if header.token:
            validated = self._retries.validate(header.token, address, header.destination_cid, now)
            if validated is None:
                return None
            original, retry_source = validated, header.destination_cid
        else:
            less_loaded = self._less_loaded_edge()
            if less_loaded is not None or self._must_prove_address(usage):
                return self._retries.create(header, address, now, less_loaded)
        if not self._admission.try_begin_handshake(network, now):
            return None
        if (reason := self._admission.connection_refusal(usage, len(self._connections), now)) is not None:
            return refusal_packet(header, reason)
        quic = ServerQuicConnection(
            edge=self._share.edge,
            reset_token=self._resets.token,
            reset_delay=partial(self._admission.reset_delay, network),
            configuration=self._configuration,
            original_destination_connection_id=original,
            retry_source_connection_id=retry_source,
            session_ticket_fetcher=self._share.tickets.pop,
            session_ticket_handler=self._share.tickets.add,
        )
        client = (str(address[0]).removeprefix("::ffff:"), int(address[1]))
        make_router = partial(Router, quic, self._service, client, self._address, usage)
        connection = Connection(quic, self._connections, usage, make_router, self._limits.handshake_timeout)
        self._connections.add(connection, header.destination_cid, quic.host_cid)
        return connection

    def _less_loaded_edge(self) -> Edge | None:
        """The edge to which new clients should go, if it is not this one."""
        share = self._share
        number = None if share.counts is None else share.counts.less_loaded_edge()
        return None if number is None else Edge(number, share.edge.total)

    def _must_prove_address(self, usage: Usage) -> bool:
        handshaking = self._connections.handshaking
        of_address = sum(connection.usage is usage for connection in handshaking)
        return self._admission.must_prove_address(len(handshaking), of_address)
