"""Limits of one client, or one address, at the HTTP/3 server; hostile clients do not affect others."""

from __future__ import annotations

import asyncio
import gc
import json
import os
import random
import socket
import time
from contextlib import AsyncExitStack, suppress

import pytest
from aioquic.h3.connection import ErrorCode
from aioquic.quic.packet import QuicErrorCode

from tests.eventually import eventually
from tests.render.transport.client import Client, FakeFrames, connect, request_body
from tests.render.transport.serving import served
from tigas_render.admission import connections as connections_module
from tigas_render.admission.limits import Limits
from tigas_render.transport import server as server_module
from tigas_render.transport.aioquic_ext.quic import MAX_STREAMS, MIN_STREAMS
from tigas_render.transport.connection import Connection
from tigas_render.transport.server import Http3Server

pytestmark = pytest.mark.anyio

OTHER = "127.0.0.2"
"""Another address than the usual one."""


async def is_served(server: Http3Server, source: str = "127.0.0.1") -> bool:
    async with connect(server.port, source=source) as client:
        return (await client.fetch("GET", "/")).status == 200


async def refusal(server: Http3Server, source: str = "127.0.0.1") -> str:
    """Why a client from an address is not connected."""
    async with connect(server.port, source=source, wait=False) as client:
        client.transmit()
        await client.until(lambda: client.terminated)
        assert client.terminated is not None
        assert client.terminated.error_code == QuicErrorCode.CONNECTION_REFUSED
        return client.terminated.reason_phrase


async def test_clients_beyond_the_limit_are_told_so_until_one_leaves() -> None:
    async with served(Limits(connections=1)) as server:
        async with connect(server.port) as first:
            assert "The server has" in await refusal(server, OTHER)
            assert (await first.fetch("GET", "/")).status == 200
        await eventually(lambda: server.connections == 0)
        assert await is_served(server, OTHER)


async def test_one_address_cannot_take_every_place() -> None:
    async with served(Limits(connections_per_address=2)) as server:
        async with connect(server.port), connect(server.port):
            assert "Your address has" in await refusal(server)
            assert await is_served(server, OTHER)
        await eventually(lambda: server.connections == 0)
        assert server._connections.usage == {}


async def test_one_address_cannot_open_connections_all_the_time() -> None:
    async with served(Limits(connections_per_address=2, handshakes_per_s=0.001)) as server:
        for _ in range(2):
            assert await is_served(server)
            await eventually(lambda: server.connections == 0)
        assert "too fast" in await refusal(server)
        assert await is_served(server, OTHER)


async def test_a_burst_of_connections_of_one_address_holds_nobody_else_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections_module, "HANDSHAKE_BURST", 1)
    monkeypatch.setattr(connections_module, "HANDSHAKES_PER_S", 0.001)
    async with served() as server, connect(server.port), connect(server.port, wait=False) as second:
        second.transmit()  # left to be sent again
        assert await is_served(server, OTHER)
        await eventually(lambda: server.connections == 1)


async def test_hundreds_behind_one_address_are_handled_in_few_turns_and_hold_nobody_else_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(server_module, "TIME_SLICE_S", 20.0)  # so that the count alone ends a turn
    turns: list[list[str]] = []
    async with served() as server, connect(server.port), connect(server.port, source=OTHER):
        monkeypatch.setattr(server, "_handle_datagram", lambda datagram: turns[-1].append(datagram.address[0]))
        now = time.monotonic()
        for port in range(1000, 1400):
            server._inbox.add(bytes(50), ("127.0.0.1", port), now)
        while server._inbox:
            if len(turns) == 2:
                server._inbox.add(bytes(50), (OTHER, 1000), now)
            turns.append([])
            server._process_inbox()
        assert turns[2].count(OTHER) == 1
        assert len(turns) < 60
        assert max(map(len, turns)) <= 400 / 8 + 2


@pytest.mark.slow
async def test_connections_of_one_address_that_come_at_once_all_come_in() -> None:
    async with served() as server, AsyncExitStack() as stack:
        clients = [stack.enter_async_context(connect(server.port)) for _ in range(12)]
        await asyncio.gather(*clients)
        assert server.connections >= 12, "a late copy of a first packet begins another"


async def reset_streams(client: Client) -> int:
    """Open and reset streams until the server allows no more. Returns how many they were."""
    session = await client.connect_webtransport()
    quic, count = client._quic, 0
    while count < 2 * MAX_STREAMS:
        with suppress(TimeoutError):
            async with asyncio.timeout(1):
                await client.until(lambda: quic.get_next_available_stream_id() // 4 < quic._remote_max_streams_bidi)
        if quic.get_next_available_stream_id() // 4 >= quic._remote_max_streams_bidi:
            break
        stream_id = client.open_stream(session, b"{", end=False)
        quic.stop_stream(stream_id, 0)
        quic.reset_stream(stream_id, 0)
        client.transmit()
        count += 1
    return count


async def test_streams_that_one_address_resets_are_replaced_slowly_on_all_of_its_connections() -> None:
    async with (
        served(Limits(resets_per_s=0.001)) as server,
        connect(server.port) as first,
        connect(server.port) as second,
        connect(server.port, source=OTHER) as other,
    ):
        reset = await reset_streams(first) + await reset_streams(second)
        assert reset <= 2 * MAX_STREAMS, "no more than may be open at a time"
        for _ in range(MAX_STREAMS):
            assert (await other.fetch("GET", "/")).status == 200


@pytest.mark.parametrize(
    ("limits", "others"),
    [(Limits(unvalidated=0), 1), (Limits(unvalidated=2), 0), (Limits(unvalidated_per_address=1), 0)],
)
async def test_handshakes_under_way_make_an_address_prove_itself(limits: Limits, others: int) -> None:
    """others: how often another address has to."""
    async with served(limits) as server, connect(server.port, wait=False) as deaf:
        deaf.datagram_received = lambda *_: None  # type: ignore[method-assign]
        deaf.transmit()
        if limits.unvalidated:
            await eventually(lambda: server.connections == 1)
        async with connect(server.port) as suspect, connect(server.port, source=OTHER) as other:
            assert suspect._quic._retry_count == (limits.unvalidated != 2)
            assert other._quic._retry_count == others
            assert (await suspect.fetch("GET", "/")).status == 200


async def test_one_address_has_so_many_sessions_and_no_more() -> None:
    limits = Limits(sessions_per_address=3)
    async with served(limits) as server, connect(server.port) as one, connect(server.port) as two:
        sessions = [await client.connect_webtransport() for client in (one, one, two)]
        refused = await two.response(await two.connect_webtransport())
        assert refused.status == 429
        assert "Your address has" in json.loads(refused.body)["detail"]
        async with connect(server.port, source=OTHER) as other:
            assert other.responses[await other.connect_webtransport()].status == 200
        await one.end(sessions[0])
        assert two.responses[await two.connect_webtransport()].status == 200


async def test_one_address_has_so_many_requests_and_no_more() -> None:
    source = FakeFrames()
    source.held = True
    async with (
        served(Limits(requests_per_address=3), source) as server,
        connect(server.port) as one,
        connect(server.port) as two,
    ):
        its, session = await one.connect_webtransport(), await two.connect_webtransport()
        waiting = [one.open_stream(its, request_body(seq=seq)) for seq in range(3)]
        await eventually(lambda: len(source.requests) == 3)
        header, problem = await two.frame(session, request_body())
        assert header["status"] == 503
        assert "Your address has" in json.loads(problem)["detail"]
        assert (await two.fetch("GET", "/")).status == 503
        assert await is_served(server, OTHER)
        for seq, stream in enumerate(waiting):
            source.release(seq)
            await one.response(stream)
        assert (await two.fetch("GET", "/")).status == 200


@pytest.mark.slow
async def test_two_hundred_connections_that_are_dropped_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections_module, "HANDSHAKES_PER_S", 1e6)  # else they would be begun one after the other
    async with served(Limits(idle_timeout=5.0, connections_per_address=512)) as server:
        for number in range(200):
            async with connect(server.port) as client:
                client.request("GET", "/")
                if number % 2:  # it leaves without closing the connection
                    client._quic.close = lambda **_: None  # type: ignore[method-assign]
        assert await is_served(server)
        await eventually(lambda: server.connections == 0)
        assert server._connections.by_cid == {}
        gc.collect()
        assert not any(type(thing) is Connection for thing in gc.get_objects())


async def test_a_handshake_that_is_never_finished_is_forgotten() -> None:
    async with served(Limits(handshake_timeout=0.5)) as server, connect(server.port, wait=False) as client:
        client.datagram_received = lambda *_: None  # type: ignore[method-assign]  # deaf to the answer
        client.transmit()
        await eventually(lambda: server.connections == 1)
        await eventually(lambda: server.connections == 0)


async def test_garbage_is_ignored() -> None:
    generator = random.Random(6)
    async with served(Limits(handshake_timeout=0.2)) as server, connect(server.port) as client:
        known = next(iter(server._connections.by_cid))
        version = (1).to_bytes(4, "big")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            for data in (
                b"",
                b"\0",
                b"\xff" * 1500,
                b"\x40" + known + generator.randbytes(50),  # a short header with a good connection id
                b"\xc0" + version + b"\x08" + known + b"\x00" + generator.randbytes(1300),
                b"\xc0" + version + b"\x08" + b"12345678" + b"\x00\x00\x44\xb0" + bytes(1300),  # an Initial of zeros
                b"\xc0" + version + b"\xff" * 1300,
                b"\xc0" + b"\x0a\x0a\x0a\x0a" + b"\x08" + b"12345678" + b"\x00" + bytes(1300),  # another version
                *(generator.randbytes(generator.randrange(1, 1500)) for _ in range(300)),
                *(b"\xc0" + version + generator.randbytes(1300) for _ in range(300)),
            ):
                sock.sendto(data, ("127.0.0.1", server.port))
        assert (await client.fetch("GET", "/")).status == 200
        assert await is_served(server)


async def test_another_version_is_negotiated() -> None:
    async with (
        served() as server,
        connect(server.port, supported_versions=[0x0A0A0A0A, 1], original_version=0x0A0A0A0A) as client,
    ):
        assert (await client.fetch("GET", "/")).status == 200


async def test_an_error_of_a_client_or_in_the_quic_stack_ends_one_connection_only(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with served() as server, connect(server.port) as good:
        async with connect(server.port) as bad:
            bad.send(bad._quic.get_next_available_stream_id(), b"\x00\x01x")  # DATA before HEADERS
            await bad.until(lambda: bad.terminated)
        await eventually(lambda: server.connections == 1)
        async with connect(server.port) as bad:
            _, broken = server._connections
            broken._quic.receive_datagram = lambda *_, **__: 1 / 0  # type: ignore[method-assign,assignment]
            bad.request("GET", "/")
            await eventually(lambda: server.connections == 1)
        assert (await good.fetch("GET", "/")).status == 200
    assert "ZeroDivisionError" in caplog.text


async def test_requests_whose_headers_never_end_are_reset_and_leave_room_for_others() -> None:
    async with (
        served(Limits(request_timeout=0.1, requests=8)) as server,
        connect(server.port) as hoarder,
        connect(server.port) as good,
    ):
        streams = [hoarder._quic.get_next_available_stream_id() + 4 * number for number in range(MIN_STREAMS)]
        for stream in streams:
            hoarder._quic.send_stream_data(stream, b"\x01\x40\xff" + bytes(100))  # HEADERS of 255 bytes
        hoarder.transmit()
        assert (await good.fetch("GET", "/")).status == 200
        resets = [(await hoarder.response(stream)).reset for stream in streams]
        assert set(resets) == {ErrorCode.H3_REQUEST_INCOMPLETE, ErrorCode.H3_REQUEST_REJECTED}
        assert (await hoarder.fetch("GET", "/")).status == 200


async def test_a_flood_of_requests_and_cancellations_leaves_nothing_behind() -> None:
    async with served(source=FakeFrames(os.urandom(3000))) as server, connect(server.port) as client:
        session = await client.connect_webtransport()
        for _ in range(80):
            streams = [client.open_stream(session, request_body()) for _ in range(MIN_STREAMS // 2)]
            for stream in streams[::2]:
                client.stop(stream)
            for stream in streams:
                await client.response(stream)
        (connection,) = server._connections
        assert connection.router is not None
        async with asyncio.timeout(20):
            await connection.router.drain()
        await client.frame(session, request_body())
        assert len(connection.router._h3._stream) <= 6, "the session and the control streams"
        await eventually(lambda: len(connection._quic._streams) <= 8)


async def test_a_connection_that_has_ended_waits_for_no_request() -> None:
    async with served() as server, connect(server.port) as client:
        await client.fetch("GET", "/")
        (connection,) = server._connections
        client.close()
        await eventually(lambda: server.connections == 0)
        assert connection.router is not None
        connection.router._unfinished[0] = 0.0  # as a stream does that came with the last packets
        connection._quic._credit_at = 0.0  # as after streams that were reset
        connection.transmit()
        assert connection.router.next_deadline is not None
        assert connection._due is None
