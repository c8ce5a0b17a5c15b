"""Several edges of one port: each datagram comes to its edge, and tickets are good once."""

from __future__ import annotations

import os
import random
import socket
from contextlib import AsyncExitStack, ExitStack
from datetime import UTC, datetime

import pytest
from aioquic.tls import CipherSuite, SessionTicket

from tests.render.transport.client import CERTIFICATE, connect
from tests.render.transport.serving import hello
from tigas_common.udp import bind_all, bind_shared
from tigas_render.admission.limits import Limits
from tigas_render.transport.server import Http3Server
from tigas_render.transport.shared_port import (
    MAX_LEAD,
    Edge,
    EdgeCounts,
    PortShare,
    TicketStore,
    attach_steering,
    open_counts_file,
)

LONG, SHORT = b"\xc3\x00\x00\x00\x01\x08", b"\x41"


@pytest.mark.parametrize("edges", [1, 2, 3, 6, 8])
def test_every_id_names_its_edge(edges: int) -> None:
    for number in range(edges):
        edge = Edge(number, edges)
        for first in range(256):
            cid = edge.mark_cid(bytes((first,)) + os.urandom(7))
            assert (len(cid), cid[0] % edges) == (8, number)
            assert edge.mark_cid(cid) == cid


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "::"])
@pytest.mark.parametrize("edges", [2, 5])
def test_the_kernel_delivers_every_datagram_to_the_socket_that_it_names(edges: int, host: str) -> None:
    with ExitStack() as stack:
        [first] = map(stack.enter_context, bind_all(host, 0))
        sockets = [first, *(stack.enter_context(bind_shared(first)) for _ in range(edges - 1))]
        assert attach_steering(first, edges)
        target = (host if host != "::" else "::1", first.getsockname()[1])
        for _ in range(200):
            number = random.randrange(edges)
            data = random.choice((LONG, SHORT)) + Edge(number, edges).mark_cid(os.urandom(8)) + b"rest"
            with socket.socket(first.family, socket.SOCK_DGRAM) as client:  # each from a different port
                client.sendto(data, target)
            sockets[number].settimeout(2)
            assert sockets[number].recv(100) == data


def test_a_port_that_is_shared_cannot_be_bound_by_another_service() -> None:
    with ExitStack() as stack:
        [first] = map(stack.enter_context, bind_all("127.0.0.1", 0))
        stack.enter_context(bind_shared(first))
        with pytest.raises(OSError, match="in use"):
            bind_all("127.0.0.1", first.getsockname()[1])


@pytest.mark.anyio
async def test_a_retry_token_is_good_at_the_edge_that_its_client_comes_to() -> None:
    [first] = bind_all("127.0.0.1", 0)
    sockets = (first, bind_shared(first))
    assert attach_steering(first, 2)
    key, strict = bytes(range(16)), Limits(unvalidated=0)  # so that every client has to prove its address
    async with AsyncExitStack() as stack:
        for number in range(2):
            share = PortShare(Edge(number, 2), (sockets[number],), key)
            await stack.enter_async_context(Http3Server(hello, certificate=CERTIFICATE, limits=strict, share=share))
        moved = 0
        for _ in range(10):
            client = await stack.enter_async_context(connect(first.getsockname()[1]))
            assert client._quic._retry_count == 1
            retry_source = client._quic._retry_source_connection_id
            assert retry_source is not None
            moved += client._quic.original_destination_connection_id[0] % 2 != retry_source[0] % 2
            assert (await client.fetch("GET", "/")).status == 200
        assert moved > 0


@pytest.mark.anyio
async def test_new_clients_are_sent_to_the_edge_with_the_fewest_connections() -> None:
    edges, clients = 3, 12
    [first] = bind_all("127.0.0.1", 0)
    sockets = (first, *(bind_shared(first) for _ in range(edges - 1)))
    assert attach_steering(first, edges)
    async with AsyncExitStack() as stack:
        fd = stack.enter_context(open_counts_file(edges))
        servers = []
        for number in range(edges):
            share = PortShare(Edge(number, edges), (sockets[number],), bytes(16), counts=EdgeCounts(fd, number, edges))
            server = Http3Server(hello, certificate=CERTIFICATE, share=share)
            servers.append(await stack.enter_async_context(server))
        for _ in range(clients):
            client = await stack.enter_async_context(connect(first.getsockname()[1]))
            assert (await client.fetch("GET", "/")).status == 200
        counts = [server.connections for server in servers]
        assert sum(counts) == clients
        assert max(counts) - min(counts) <= 1 + MAX_LEAD


def test_an_edge_sends_clients_away_only_if_another_has_markedly_fewer() -> None:
    with open_counts_file(3) as fd:
        one, two, three = (EdgeCounts(fd, number, 3) for number in range(3))
        two.update(5)
        three.update(4)
        assert (one.less_loaded_edge(), two.less_loaded_edge(), three.less_loaded_edge()) == (None, 0, 0)
        one.update(3)
        assert (one.less_loaded_edge(), two.less_loaded_edge(), three.less_loaded_edge()) == (None, 0, None)
        assert EdgeCounts(fd, 1, 3).less_loaded_edge() is None, "an edge that is started again has no connections"
        assert one.less_loaded_edge() == 1


def ticket(label: bytes) -> SessionTicket:
    now = datetime.now(UTC)
    return SessionTicket(0, CipherSuite.AES_128_GCM_SHA256, now, now, b"", "", label)


def test_a_ticket_is_taken_once_and_the_oldest_make_room() -> None:
    store = TicketStore(capacity=3)
    for label in (b"1", b"2", b"3", b"4"):
        store.add(ticket(label))
    assert [each.ticket for each in store] == [b"2", b"3", b"4"]
    assert store.pop(b"1") is None
    assert store.pop(b"4") is not None
    assert store.pop(b"4") is None
