"""The server as a whole: addresses, certificates, resumption, limits, and clients that mean no good."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import os
import random
import socket
from collections.abc import AsyncIterator, Callable
from datetime import UTC, datetime

import psutil
import pytest
from aioquic.h3.connection import ErrorCode
from aioquic.quic.packet import QuicErrorCode
from aioquic.tls import SessionTicket
from starlette.types import Receive, Scope, Send

from tests.render.transport.client import (
    CERTIFICATE,
    Client,
    FakeFrames,
    Recorder,
    connect,
    request_body,
    split_frame,
)
from tigas_common.certificate import Certificate
from tigas_render.transport.connection import Connection
from tigas_render.transport.frames import render_session
from tigas_render.transport.limits import Limits
from tigas_render.transport.server import Http3Server
from tigas_render.transport.stateless_reset import StatelessResets

pytestmark = pytest.mark.anyio
KEY = bytes(range(32))


async def hello(scope: Scope, receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": scope["path"].encode()})


@contextlib.asynccontextmanager
async def served(limits: Limits | None = None, source: FakeFrames | None = None) -> AsyncIterator[Http3Server]:
    sessions = {"/render": render_session(source or FakeFrames())}
    async with Http3Server(
        hello, host="127.0.0.1", certificate=CERTIFICATE, webtransport=sessions, limits=limits
    ) as server:
        yield server


async def eventually(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(20):
        while not condition():  # noqa: ASYNC110 - the server's state has no event to wait for
            await asyncio.sleep(0.005)


# -- addresses ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("listening", ["::", "localhost"])
@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
async def test_one_port_serves_both_families(host: str, listening: str) -> None:
    clients = Recorder()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        clients.add(scope["client"][0])
        await hello(scope, receive, send)

    async with (
        Http3Server(app, certificate=CERTIFICATE, host=listening) as server,
        connect(server.port, host=host) as client,
    ):
        assert (await client.fetch("GET", "/")).status == 200
    assert clients.events == [host]


async def test_by_default_only_this_machine_is_served() -> None:
    async with Http3Server(hello, certificate=CERTIFICATE) as server:
        listening = {
            one.laddr.ip
            for one in psutil.Process().net_connections("udp")
            if one.laddr and one.laddr.port == server.port
        }
    assert listening == {"127.0.0.1", "::1"}


@pytest.mark.parametrize(
    ("host", "origin", "status"),
    [
        ("localhost", None, 200),
        ("127.0.0.1", "http://localhost:8080", 200),
        ("localhost", "https://evil.example", 403),
        ("localhost", "null", 403),
        ("evil.example", "https://evil.example", 421),
    ],
)
async def test_a_session_is_opened_for_the_services_own_pages(host: str, origin: str | None, status: int) -> None:
    async with served() as server, connect(server.port) as client:
        session = await client.connect_webtransport(authority=host, origin=origin)
        assert client.responses[session].status == status


@pytest.mark.parametrize("listening", ["::", "localhost"])
async def test_without_ipv6_it_serves_ipv4(listening: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = socket.socket

    def without_ipv6(family: int = -1, *args: int, **kwargs: int) -> socket.socket:
        if family == socket.AF_INET6:
            raise OSError(97, "Address family not supported by protocol")
        return real(family, *args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(socket, "socket", without_ipv6)
        server = Http3Server(hello, certificate=CERTIFICATE, host=listening)
        await server.start()
    async with connect(server.port) as client:
        assert (await client.fetch("GET", "/")).status == 200
    await server.close()


async def test_a_port_in_use_is_an_os_error() -> None:
    async with served() as server:
        with pytest.raises(OSError, match="in use"):
            await Http3Server(hello, host="127.0.0.1", port=server.port, certificate=CERTIFICATE).start()
    with contextlib.closing(socket.socket(socket.AF_INET6, socket.SOCK_DGRAM)) as taken:
        taken.bind(("::1", 0))
        with pytest.raises(OSError, match="in use"):
            await Http3Server(hello, port=taken.getsockname()[1], certificate=CERTIFICATE).start()


# -- certificates ------------------------------------------------------------------------------------------------------


async def test_new_connections_see_a_new_certificate_and_old_ones_live_on() -> None:
    renewed = Certificate.create([], datetime.now(UTC))
    async with served() as server, connect(server.port) as old:
        server.replace_certificate(renewed)
        async with connect(server.port, certificate=renewed) as new:
            assert (await new.fetch("GET", "/new")).status == 200
        assert (await old.fetch("GET", "/old")).status == 200


# -- resumption and early data -----------------------------------------------------------------------------------------


async def ticket_from(server: Http3Server) -> SessionTicket:
    tickets: list[SessionTicket] = []
    async with connect(server.port, on_ticket=tickets.append) as client:
        await client.fetch("GET", "/")
        await client.until(lambda: tickets)
    return tickets[0]


async def send_early(client: Client, method: str, path: str, body: bytes | None = None) -> int:
    stream_id = client.request(method, path, body)
    assert client.handshake is None, "it left before the handshake was complete"
    return stream_id


async def test_idempotent_requests_may_be_early() -> None:
    async with served() as server:
        ticket = await ticket_from(server)
        async with connect(server.port, ticket=ticket, wait=False) as client:
            streams = [
                await send_early(client, "GET", "/scenes"),
                await send_early(client, "POST", "/render", b"{}"),
                await send_early(client, "POST", "/scenes/x/load", b""),
            ]
            statuses = [(await client.response(stream)).status for stream in streams]
            assert statuses == [200, 200, 425]
            assert client.handshake is not None
            assert client.handshake.early_data_accepted
            assert (await client.fetch("POST", "/scenes/x/load", b"")).status == 200, "now it is not early any more"


async def test_frames_may_be_early() -> None:
    source = FakeFrames(b"early frame")
    async with served(source=source) as server:
        ticket = await ticket_from(server)
        async with connect(server.port, ticket=ticket, wait=False) as client:
            session = await client.connect_webtransport()
            assert (await client.frame(session, request_body(seq=4)))[1] == b"early frame"


async def test_a_ticket_is_good_once() -> None:
    """So a recorded first flight is worthless to whoever plays it again."""
    async with served() as server:
        ticket = await ticket_from(server)
        for expected in (True, False):
            async with connect(server.port, ticket=ticket, wait=False) as client:
                stream = await send_early(client, "GET", "/")
                assert (await client.handshaken()).session_resumed is expected
                if expected:
                    assert (await client.response(stream)).status == 200


# -- ending ------------------------------------------------------------------------------------------------------------


async def test_closing_lets_running_requests_finish_and_takes_no_more() -> None:
    seen, release = Recorder(), asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        seen.add(scope["path"])
        await release.wait()
        await hello(scope, receive, send)

    async with (
        Http3Server(app, host="127.0.0.1", certificate=CERTIFICATE, limits=Limits(grace=10)) as server,
        connect(server.port) as client,
    ):
        running = client.request("GET", "/running")
        await seen.until("/running")
        closing = asyncio.create_task(server.close())
        await asyncio.sleep(0)
        late = client.request("GET", "/late")
        assert (await client.response(late)).reset is not None
        release.set()
        assert (await client.response(running)).body == b"/running"
        await closing
        await client.until(lambda: client.terminated)
        assert client.terminated is not None
        assert client.terminated.error_code == 0x100
    assert seen.events == ["/running"]


async def test_closing_does_not_wait_longer_than_its_grace() -> None:
    source = FakeFrames()
    source.held = True
    async with served(Limits(grace=0.05), source) as server, connect(server.port) as client:
        client.open_stream(await client.connect_webtransport(), request_body(seq=1))
        await source.until(lambda: source.requests)
        await server.close()
        assert source.cancelled == [1]
        assert server.connections == 0


async def test_closing_does_not_wait_for_an_application_that_never_returns() -> None:
    seen = Recorder()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        seen.add("started")
        try:
            await asyncio.Event().wait()
        finally:
            seen.add("ended")

    async with Http3Server(app, host="127.0.0.1", certificate=CERTIFICATE) as server, connect(server.port) as client:
        client.request("GET", "/")
        await seen.until("started")
        await server.close()
        assert seen.events == ["started", "ended"]


# -- limits and hostile clients ----------------------------------------------------------------------------------------


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
            assert "The server has" in await refusal(server, "127.0.0.2")
            assert (await first.fetch("GET", "/")).status == 200
        await eventually(lambda: server.connections == 0)
        async with connect(server.port, source="127.0.0.2") as second:
            assert (await second.fetch("GET", "/")).status == 200


async def test_one_address_cannot_take_every_place() -> None:
    async with served(Limits(connections_per_address=2)) as server:
        async with connect(server.port), connect(server.port):
            assert "Your address has" in await refusal(server)
            async with connect(server.port, source="127.0.0.2") as other:
                assert (await other.fetch("GET", "/")).status == 200
        await eventually(lambda: server.connections == 0)
        assert server._usage == {}


async def test_one_address_cannot_open_connections_all_the_time() -> None:
    async with served(Limits(connections_per_address=2, handshakes_per_s=0.001)) as server:
        for _ in range(2):
            async with connect(server.port) as client:
                assert (await client.fetch("GET", "/")).status == 200
            await eventually(lambda: server.connections == 0)
        assert "too fast" in await refusal(server)
        async with connect(server.port, source="127.0.0.2") as other:
            assert (await other.fetch("GET", "/")).status == 200


async def test_an_address_with_unanswered_handshakes_has_to_prove_itself() -> None:
    async with (
        served(Limits(unvalidated_per_address=1)) as server,
        connect(server.port, wait=False) as deaf,
    ):
        deaf.datagram_received = lambda *_: None  # type: ignore[method-assign]
        deaf.transmit()
        await eventually(lambda: server.connections == 1)
        async with connect(server.port) as suspect, connect(server.port, source="127.0.0.2") as other:
            assert suspect._quic._retry_count == 1
            assert other._quic._retry_count == 0
            assert (await suspect.fetch("GET", "/")).status == 200
        async with connect(server.port) as first:
            await first.fetch("GET", "/")


async def test_one_address_has_so_many_sessions_and_no_more() -> None:
    limits = Limits(sessions_per_address=3)
    async with served(limits) as server, connect(server.port) as one, connect(server.port) as two:
        sessions = [await client.connect_webtransport() for client in (one, one, two)]
        refused = await two.response(await two.connect_webtransport())
        assert refused.status == 429
        assert "Your address has" in json.loads(refused.body)["detail"]
        async with connect(server.port, source="127.0.0.2") as other:
            assert other.responses[await other.connect_webtransport()].status == 200
        one._quic.send_stream_data(sessions[0], b"", end_stream=True)
        one.transmit()
        await one.response(sessions[0])
        assert two.responses[await two.connect_webtransport()].status == 200


async def test_one_address_has_so_many_requests_and_no_more() -> None:
    source = FakeFrames()
    source.held = True
    limits = Limits(requests_per_address=3)
    async with (
        served(limits, source) as server,
        connect(server.port) as one,
        connect(server.port) as two,
        connect(server.port, source="127.0.0.2") as other,
    ):
        its, session = await one.connect_webtransport(), await two.connect_webtransport()
        waiting = [one.open_stream(its, request_body(seq=seq)) for seq in range(3)]
        await source.until(lambda: len(source.requests) == 3)
        header, problem = await two.frame(session, request_body())
        assert header["status"] == 503
        assert "Your address has" in json.loads(problem)["detail"]
        assert (await two.fetch("GET", "/")).status == 503
        assert (await other.fetch("GET", "/")).status == 200
        for seq, stream in enumerate(waiting):
            source.release(seq)
            await one.response(stream)
        assert (await two.fetch("GET", "/")).status == 200


async def test_a_busy_server_asks_for_proof_of_the_address() -> None:
    async with served(Limits(unvalidated=0)) as server, connect(server.port) as client:
        assert client._quic._retry_count == 1
        assert (await client.fetch("GET", "/")).status == 200


async def test_two_hundred_connections_that_are_dropped_are_forgotten() -> None:
    async with served(Limits(idle_timeout=1.0, connections_per_address=512)) as server:
        for number in range(200):
            async with connect(server.port) as client:
                client.request("GET", "/")
                if number % 2:
                    client.vanish()
        async with connect(server.port) as client:
            assert (await client.fetch("GET", "/")).status == 200
        await eventually(lambda: server.connections == 0)
        assert server._by_cid == {}
        gc.collect()
        assert not any(type(thing) is Connection for thing in gc.get_objects())


async def test_a_handshake_that_is_never_finished_is_forgotten() -> None:
    async with served(Limits(handshake_timeout=0.05)) as server, connect(server.port, wait=False) as client:
        client.datagram_received = lambda *_: None  # type: ignore[method-assign]  # deaf to the answer
        client.transmit()
        await eventually(lambda: server.connections == 1)
        await eventually(lambda: server.connections == 0)


async def test_garbage_is_ignored() -> None:
    generator = random.Random(6)
    async with served(Limits(handshake_timeout=0.2)) as server, connect(server.port) as client:
        known = next(iter(server._by_cid))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            target = ("127.0.0.1", server.port)
            version = (1).to_bytes(4, "big")
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
                sock.sendto(data, target)
        assert (await client.fetch("GET", "/")).status == 200
        async with connect(server.port) as other:
            assert (await other.fetch("GET", "/")).status == 200


async def test_another_version_is_negotiated() -> None:
    async with (
        served() as server,
        connect(server.port, supported_versions=[0x0A0A0A0A, 1], original_version=0x0A0A0A0A) as client,
    ):
        assert (await client.fetch("GET", "/")).status == 200


async def test_a_client_that_breaks_the_protocol_loses_its_connection_only() -> None:
    async with served() as server, connect(server.port) as good, connect(server.port) as bad:
        stream = bad._quic.get_next_available_stream_id()
        bad._quic.send_stream_data(stream, b"\x00\x01x")  # DATA before HEADERS
        bad.transmit()
        await bad.until(lambda: bad.terminated)
        assert (await good.fetch("GET", "/")).status == 200


async def test_an_error_in_the_quic_stack_ends_one_connection_only(caplog: pytest.LogCaptureFixture) -> None:
    async with served() as server, connect(server.port) as good:
        (healthy,) = server._connections
        async with connect(server.port) as bad:
            (broken,) = set(server._connections) - {healthy}
            broken._quic.receive_datagram = lambda *_, **__: 1 / 0  # type: ignore[method-assign,assignment]
            bad.request("GET", "/")
            await eventually(lambda: server.connections == 1)
        assert (await good.fetch("GET", "/")).status == 200
    assert "ZeroDivisionError" in caplog.text


async def test_streams_opened_and_never_finished_leave_room_for_others() -> None:
    source = FakeFrames()
    async with (
        served(Limits(request_timeout=0.1), source) as server,
        connect(server.port) as hoarder,
        connect(server.port) as good,
    ):
        session = await hoarder.connect_webtransport()
        its = await good.connect_webtransport()
        streams = [hoarder.open_stream(session, b"{", end=False) for _ in range(120)]
        assert (await good.frame(its, request_body()))[0]["status"] == 200
        statuses = [split_frame(bytes((await hoarder.response(s)).body))[0]["status"] for s in streams]
        assert set(statuses) == {400, 503}
        assert (await hoarder.frame(session, request_body()))[0]["status"] == 200


async def test_requests_whose_headers_never_end_are_reset_and_leave_room_for_others() -> None:
    async with (
        served(Limits(request_timeout=0.1)) as server,
        connect(server.port) as hoarder,
        connect(server.port) as good,
    ):
        streams = [hoarder._quic.get_next_available_stream_id() + 4 * number for number in range(100)]
        for stream in streams:
            hoarder._quic.send_stream_data(stream, b"\x01\x40\xff" + bytes(100))  # HEADERS of 255 bytes
        hoarder.transmit()
        assert (await good.fetch("GET", "/")).status == 200
        resets = [(await hoarder.response(stream)).reset for stream in streams]
        assert set(resets) == {ErrorCode.H3_REQUEST_INCOMPLETE, ErrorCode.H3_REQUEST_REJECTED}
        assert (await hoarder.fetch("GET", "/")).status == 200


async def test_a_flood_of_requests_and_cancellations_leaves_nothing_behind() -> None:
    source = FakeFrames(os.urandom(3000))
    async with served(source=source) as server, connect(server.port) as client:
        session = await client.connect_webtransport()
        for _ in range(20):
            streams = [client.open_stream(session, request_body()) for _ in range(50)]
            for stream in streams[::2]:
                client.stop(stream)
            for stream in streams:
                await client.response(stream)
        (connection,) = server._connections
        assert connection.router is not None
        async with asyncio.timeout(20):
            await connection.router.finish()
        await client.frame(session, request_body())
        assert len(connection.router._h3._stream) <= 6, "the session and the control streams"
        await eventually(lambda: len(connection._quic._streams) <= 8)


# -- restarts ----------------------------------------------------------------------------------------------------------


async def test_a_client_of_a_server_that_is_gone_hears_of_it_from_the_next() -> None:
    async with Http3Server(hello, host="127.0.0.1", certificate=CERTIFICATE, reset_key=KEY) as server:
        port = server.port
        async with connect(port) as client:
            assert (await client.fetch("GET", "/")).status == 200
            quic = client._quic
            ids = [quic._peer_cid, *quic._peer_cid_available]
            assert len(ids) > 1
    async with Http3Server(hello, host="127.0.0.1", port=port, certificate=CERTIFICATE, reset_key=KEY):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.setblocking(False)
            sock.connect(("127.0.0.1", port))
            for known in ids:
                sock.send(b"\x40" + known.cid + bytes(40))
                async with asyncio.timeout(5):
                    reset = await asyncio.get_running_loop().sock_recv(sock, 2000)
                assert len(reset) < 49
                assert reset[-16:] == known.stateless_reset_token


async def test_nobody_gets_a_reset_of_a_connection_that_lives() -> None:
    async with (
        Http3Server(hello, host="127.0.0.1", certificate=CERTIFICATE, reset_key=KEY) as server,
        connect(server.port) as client,
    ):
        assert (await client.fetch("GET", "/")).status == 200
        living, unknown = client._quic._peer_cid.cid, os.urandom(8)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.setblocking(False)
            sock.connect(("127.0.0.1", server.port))
            for cid in (living, unknown):
                sock.send(b"\x40" + cid + bytes(40))
            async with asyncio.timeout(5):
                only = await asyncio.get_running_loop().sock_recv(sock, 2000)
        assert only[-16:] == StatelessResets(KEY, server.port).token(unknown)
        assert (await client.fetch("GET", "/")).status == 200
