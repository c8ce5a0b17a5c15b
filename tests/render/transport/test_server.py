"""The server as a whole: addresses, certificates, resumption, ending and restarts."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from datetime import UTC, datetime

import psutil
import pytest
from aioquic.tls import SessionTicket
from starlette.types import Receive, Scope, Send

from tests.eventually import eventually
from tests.render.transport.client import CERTIFICATE, FakeFrames, connect, request_body
from tests.render.transport.serving import hello, served
from tigas_render.admission.limits import Limits
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.server import Http3Server
from tigas_render.transport.stateless import StatelessResets

pytestmark = pytest.mark.anyio
KEY = bytes(range(32))


@pytest.mark.parametrize("listening", ["::", "localhost"])
@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
async def test_one_port_serves_both_families(host: str, listening: str) -> None:
    clients: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        clients.append(scope["client"][0])
        await hello(scope, receive, send)

    async with (
        Http3Server(app, certificate=CERTIFICATE, host=listening) as server,
        connect(server.port, host=host) as client,
    ):
        assert (await client.fetch("GET", "/")).status == 200
    assert clients == [host]


async def test_by_default_only_this_machine_is_served() -> None:
    async with Http3Server(hello, certificate=CERTIFICATE) as server:
        of_port = [one.laddr for one in psutil.Process().net_connections("udp") if one.laddr.port == server.port]
    assert {address.ip for address in of_port} == {"127.0.0.1", "::1"}


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

    async with contextlib.AsyncExitStack() as stack:
        with monkeypatch.context() as patch:
            patch.setattr(socket, "socket", without_ipv6)
            server = await stack.enter_async_context(Http3Server(hello, certificate=CERTIFICATE, host=listening))
        client = await stack.enter_async_context(connect(server.port))
        assert (await client.fetch("GET", "/")).status == 200


async def test_a_port_in_use_is_an_os_error() -> None:
    with contextlib.closing(socket.socket(socket.AF_INET6, socket.SOCK_DGRAM)) as taken:
        taken.bind(("::1", 0))
        async with served() as server:
            for host, port in (("127.0.0.1", server.port), ("localhost", taken.getsockname()[1])):
                with pytest.raises(OSError, match="in use"):
                    async with Http3Server(hello, host=host, port=port, certificate=CERTIFICATE):
                        pass


async def test_new_connections_see_a_new_certificate_and_old_ones_live_on() -> None:
    renewed = Certificate.create([], datetime.now(UTC))
    async with served() as server, connect(server.port) as old:
        server.replace_certificate(renewed)
        async with connect(server.port, certificate=renewed) as new:
            assert (await new.fetch("GET", "/new")).status == 200
        assert (await old.fetch("GET", "/old")).status == 200


async def ticket_from(server: Http3Server) -> SessionTicket:
    tickets: list[SessionTicket] = []
    async with connect(server.port, on_ticket=tickets.append) as client:
        await client.fetch("GET", "/")
        await client.until(lambda: tickets)
    return tickets[0]


async def test_idempotent_requests_may_be_early() -> None:
    async with served() as server:
        ticket = await ticket_from(server)
        async with connect(server.port, ticket=ticket, wait=False) as client:
            requests = (("GET", "/scenes", None), ("POST", "/render", b"{}"), ("POST", "/scenes/x/load", b""))
            streams = [client.request(*request) for request in requests]
            assert client.handshake is None, "they left before the handshake was complete"
            assert [(await client.response(stream)).status for stream in streams] == [200, 200, 425]
            assert client.handshake is not None
            assert client.handshake.early_data_accepted
            assert (await client.fetch("POST", "/scenes/x/load", b"")).status == 200, "now it is not early any more"


async def test_frames_may_be_early() -> None:
    async with served(source=FakeFrames(b"early frame")) as server:
        ticket = await ticket_from(server)
        async with connect(server.port, ticket=ticket, wait=False) as client:
            session = await client.connect_webtransport()
            assert (await client.frame(session, request_body(seq=4)))[1] == b"early frame"


async def test_a_ticket_is_good_once() -> None:
    """So replaying a recorded first flight is worthless."""
    async with served() as server:
        ticket = await ticket_from(server)
        for expected in (True, False):
            async with connect(server.port, ticket=ticket, wait=False) as client:
                stream = client.request("GET", "/")
                await client.until(lambda client=client: client.handshake)  # type: ignore[misc]
                assert client.handshake is not None
                assert client.handshake.session_resumed is expected
                if expected:
                    assert (await client.response(stream)).status == 200


async def test_closing_lets_running_requests_finish_and_takes_no_more() -> None:
    seen: list[str] = []
    release = asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        seen.append(scope["path"])
        await release.wait()
        await hello(scope, receive, send)

    async with served(Limits(grace=10), app=app) as server, connect(server.port) as client:
        running = client.request("GET", "/running")
        await eventually(lambda: seen)
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
    assert seen == ["/running"]


async def test_closing_waits_for_no_frame_and_no_application_beyond_its_grace() -> None:
    source = FakeFrames()
    source.held = True
    seen: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        seen.append("started")
        try:
            await asyncio.Event().wait()
        finally:
            seen.append("ended")

    async with served(Limits(grace=0.05), source, app=app) as server, connect(server.port) as client:
        client.open_stream(await client.connect_webtransport(), request_body(seq=1))
        client.request("GET", "/")
        await eventually(lambda: source.requests and seen)
        await server.close()
        assert source.cancelled == [1]
        assert seen == ["started", "ended"]
        assert server.connections == 0


async def reset_of(port: int, *cids: bytes) -> bytes:
    """The first answer to packets with these connection ids."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setblocking(False)
        sock.connect(("127.0.0.1", port))
        for cid in cids:
            sock.send(b"\x40" + cid + bytes(40))
        async with asyncio.timeout(5):
            return await asyncio.get_running_loop().sock_recv(sock, 2000)


async def test_a_client_of_a_server_that_is_gone_hears_of_it_from_the_next() -> None:
    async with (
        Http3Server(hello, host="127.0.0.1", certificate=CERTIFICATE, reset_key=KEY) as server,
        connect(server.port) as client,
    ):
        assert (await client.fetch("GET", "/")).status == 200
        ids = [client._quic._peer_cid, *client._quic._peer_cid_available]
        assert len(ids) > 1
        living, unknown = ids[0].cid, os.urandom(8)
        only = await reset_of(server.port, living, unknown)
        assert only[-16:] == StatelessResets(KEY, server.port).token(unknown), "none of a connection that lives"
        assert (await client.fetch("GET", "/")).status == 200
    async with Http3Server(hello, host="127.0.0.1", port=server.port, certificate=CERTIFICATE, reset_key=KEY):
        for known in ids:
            reset = await reset_of(server.port, known.cid)
            assert len(reset) < 49
            assert reset[-16:] == known.stateless_reset_token
