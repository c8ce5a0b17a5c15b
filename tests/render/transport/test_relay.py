"""Two servers of one port in one process, and a kernel that brings datagrams to the wrong one."""

from __future__ import annotations

import socket
from contextlib import AsyncExitStack

import pytest

from tests.render.transport.client import CERTIFICATE, FakeFrames, connect, request_body
from tests.render.transport.serving import eventually, hello
from tigas_render.admission.limits import Limits
from tigas_render.transport.cids import Edge
from tigas_render.transport.frames import render_session
from tigas_render.transport.relay import Relay
from tigas_render.transport.server import Http3Server
from tigas_render.transport.share import Share
from tigas_render.transport.steering import steer
from tigas_render.transport.udp import bind_all, bind_another

pytestmark = pytest.mark.anyio


async def test_datagrams_are_passed_on_to_their_edge_with_address_and_time() -> None:
    async with AsyncExitStack() as stack:
        pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM) for _ in range(2)]
        for each in (one for pair in pairs for one in pair):
            stack.enter_context(each)
        relays = [Relay(Edge(n, 2), pairs[n][0].dup(), [pair[1].dup() for pair in pairs]) for n in range(2)]
        heard: list[tuple[bytes, object, float]] = []
        relays[1].start(lambda *datagram: heard.append(datagram), lambda: None)
        addresses = (("127.0.0.1", 4), ("fe80::1", 5, 6, 7))
        datagrams = [(b"\x41\x01one", addresses[0], 0.25), (b"\xc3\x00\x00\x00\x01\x08\x03two", addresses[1], 1e9)]
        for data, address, arrived in datagrams:
            assert relays[0].pass_on(data, address, arrived)
        assert not relays[0].pass_on(b"\x41\x02own", addresses[0], 0.0)
        await eventually(lambda: len(heard) == 2)
        assert heard == datagrams
        for relay in relays:
            relay.close()


async def test_connections_of_two_edges_live_although_the_kernel_steers_nothing() -> None:
    [first] = bind_all("127.0.0.1", 0)
    sockets = (first, bind_another(first))
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM) for _ in range(2)]
    frames = [FakeFrames(body=b"of edge 0"), FakeFrames(body=b"of edge 1")]
    async with AsyncExitStack() as stack:
        servers = []
        for number in range(2):
            edge = Edge(number, 2)
            relay = Relay(edge, pairs[number][0], [pair[1].dup() for pair in pairs])
            server = Http3Server(
                hello,
                certificate=CERTIFICATE,
                webtransport={"/render": render_session(frames[number])},
                share=Share(edge, (sockets[number],), bytes(16), None, relay),
            )
            servers.append(await stack.enter_async_context(server))
        owners = set()
        for _ in range(12):  # the kernel brings some of these to the other
            client = await stack.enter_async_context(connect(servers[0].port))
            session = await client.connect_webtransport()
            for _ in range(5):
                _, body = await client.frame(session, request_body())
                owners.add(body)
        assert owners == {b"of edge 0", b"of edge 1"}
        assert sum(server.connections for server in servers) == 12
    for _, outbox in pairs:
        outbox.close()


async def test_a_retry_token_is_good_at_the_edge_that_its_client_comes_to() -> None:
    [first] = bind_all("127.0.0.1", 0)
    sockets = (first, bind_another(first))
    assert steer(first, 2)
    key, strict = bytes(range(16)), Limits(unvalidated=0)  # so that every client has to prove its address
    async with AsyncExitStack() as stack:
        servers = [
            await stack.enter_async_context(
                Http3Server(hello, certificate=CERTIFICATE, limits=strict, share=Share(Edge(n, 2), (sockets[n],), key))
            )
            for n in range(2)
        ]
        moved = 0
        for _ in range(10):
            client = await stack.enter_async_context(connect(servers[0].port))
            assert client._quic._retry_count == 1
            moved += (
                client._quic.original_destination_connection_id[0] % 2
                != client._quic._retry_source_connection_id[0] % 2  # type: ignore[index]
            )
            assert (await client.fetch("GET", "/")).status == 200
        assert moved > 0
