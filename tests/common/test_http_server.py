"""Limits on connections and on the time that requests take, for all services alike."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from datetime import UTC, datetime

import psutil
import pytest
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket
from websockets.asyncio.client import connect

from tests.common.raw_client import ASK, TIMEOUT_S, Answer, connected
from tests.prerequisites import LINUX
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.runner import serve_http
from tigas_common.web import ARRIVAL_KEY
from tigas_render.transport.certificate import Certificate

pytestmark = pytest.mark.anyio
HERE = Address("127.0.0.1", 0)
LONG_S = 60


def server_tls() -> ssl.SSLContext:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    Certificate.create(["localhost"], datetime.now(UTC)).load_into(tls)
    return tls


def client_tls() -> ssl.SSLContext:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
    return tls


async def test_all_addresses_together_have_a_limit_and_a_place_that_is_left_is_free() -> None:
    limits = HttpLimits(connections=3, header_s=LONG_S)
    async with serve_http(Response("ok"), HERE, limits) as port, AsyncExitStack() as stack:
        first, *_ = [await stack.enter_async_context(connected(port, f"127.0.0.{number}")) for number in (2, 3, 4)]
        async with connected(port, "127.0.0.5") as refused:
            answer = await refused.answer()
            assert (answer.status, answer.problem) == (503, "tigas:too-many-connections")
            assert await refused.ended() == b""
        first.say(ASK.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
        assert (await first.answer()).status == 200
        await first.ended()
        async with connected(port, "127.0.0.5") as admitted:
            admitted.say(ASK)
            assert (await admitted.answer()).status == 200


async def test_a_thousand_connections_of_one_address_leave_room_for_others() -> None:
    assert HttpLimits().connections_per_address <= HttpLimits().connections / 4
    limits = HttpLimits(connections_per_address=20, header_s=LONG_S, idle_s=LONG_S)
    async with serve_http(Response("ok"), HERE, limits) as port, AsyncExitStack() as stack:
        crowd = [await stack.enter_async_context(connected(port)) for _ in range(1000)]
        refused = [await client.answer() for client in crowd[20:]]
        assert {(answer.status, answer.problem) for answer in refused} == {(503, "tigas:too-many-connections")}
        polite = await stack.enter_async_context(connected(port, "127.0.0.2"))
        for client in (polite, *crowd[:20]):
            client.say(ASK)
            assert (await client.answer()).status == 200


async def test_a_tls_handshake_takes_a_place_and_not_for_ever() -> None:
    limits = HttpLimits(connections_per_address=2, header_s=1)
    async with serve_http(Response("ok"), HERE, limits, server_tls()) as port, AsyncExitStack() as stack:
        silent = [await stack.enter_async_context(connected(port)) for _ in range(2)]
        async with connected(port) as refused:
            assert await refused.ended() == b""
        assert [await client.ended() for client in silent] == [b"", b""]
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=client_tls())
        writer.write(ASK)
        assert b" 200 OK" in await reader.readline()
        writer.close()
        await writer.wait_closed()


async def test_a_client_that_does_not_end_tls_keeps_no_connection() -> None:
    async with serve_http(Response("ok"), HERE, HttpLimits(header_s=0.5), server_tls()) as port:

        def answer_nothing() -> None:
            plain = socket.create_connection(("127.0.0.1", port), timeout=TIMEOUT_S)
            with client_tls().wrap_socket(plain) as client, contextlib.suppress(ConnectionResetError):
                while plain_read(client):
                    pass

        await asyncio.to_thread(answer_nothing)


def plain_read(client: ssl.SSLSocket) -> bytes:
    """Received bytes below TLS, which would answer the server's close."""
    return socket.socket.recv(client, 4096)


BODY_S = 0.2
POST = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n"


async def takes_the_body(scope: Scope, receive: Receive, send: Send) -> None:
    size = 0
    while (message := await receive())["type"] == "http.request":
        size += len(message["body"])
        if not message["more_body"]:
            await Response(str(size))(scope, receive, send)
            return


async def late(scope: Scope, receive: Receive, send: Send) -> None:
    """The same, but it lets the client wait first."""
    await asyncio.sleep(2 * BODY_S)
    await takes_the_body(scope, receive, send)


async def test_parts_that_come_in_time_are_no_excuse_for_a_trickle() -> None:
    limits = HttpLimits(body_s=0.5, body_bytes_per_s=1e6, header_s=LONG_S)
    async with serve_http(takes_the_body, HERE, limits) as port, connected(port) as client:
        client.say(POST % 1000)

        async def trickle() -> None:
            while True:
                client.say(b"x")
                await asyncio.sleep(0.02)

        trickling = asyncio.create_task(trickle())
        assert (await client.answer()).problem == "tigas:request-timeout"
        trickling.cancel()


async def test_a_client_does_not_pay_for_an_application_that_is_late_which_does_not_wait_for_ever_either() -> None:
    limits, size = HttpLimits(body_s=BODY_S), 500_000
    async with serve_http(late, HERE, limits) as port, connected(port) as whole, connected(port) as cut:
        whole.say(POST % size + bytes(size))
        cut.say(POST % size + bytes(size - 1))
        assert await whole.answer() == Answer(200, str(size).encode())
        assert (await cut.answer()).problem == "tigas:request-timeout"


async def test_a_body_that_nobody_wanted_is_not_waited_for_either() -> None:
    limits = HttpLimits(body_s=0.2, idle_s=LONG_S, header_s=LONG_S)
    async with serve_http(Response("early"), HERE, limits) as port, connected(port) as client:
        client.say(POST % 1000 + b"x")
        assert (await client.answer()).body == b"early"
        assert await client.ended() == b""


async def test_a_connection_on_which_nothing_was_said_ends_without_a_word() -> None:
    async with serve_http(Response("ok"), HERE, HttpLimits(header_s=0.2)) as port, connected(port) as client:
        assert await client.ended() == b""


@pytest.mark.parametrize("number", [1, 2])
async def test_headers_that_never_end_are_given_up_of_the_first_request_and_the_second(number: int) -> None:
    limits = HttpLimits(header_s=1, idle_s=LONG_S)
    async with serve_http(Response("ok"), HERE, limits) as port, connected(port) as client:
        for _ in range(number - 1):
            client.say(ASK)
            assert (await client.answer()).status == 200
        client.say(ASK[:-2])
        answer = await client.answer()
        assert (answer.status, answer.problem) == (408, "tigas:request-timeout")
        assert await client.ended() == b""


async def test_a_connection_that_asks_nothing_more_is_closed() -> None:
    limits = HttpLimits(header_s=LONG_S, idle_s=1)
    async with serve_http(Response("ok"), HERE, limits) as port, connected(port) as client:
        client.say(ASK)
        assert (await client.answer()).status == 200
        assert await client.ended() == b""


@LINUX.mark
async def test_a_client_that_reads_nothing_loses_its_connection() -> None:
    limits = HttpLimits(header_s=LONG_S, body_s=LONG_S, idle_s=LONG_S, unread_s=0.5)
    async with serve_http(Response(bytes(10_000)), HERE, limits) as port:
        with socket.socket() as stuck:
            stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)  # the least that the system gives
            stuck.connect(("127.0.0.1", port))
            stuck.sendall(ASK * 100)

            def is_served() -> bool:
                return any(one.raddr == stuck.getsockname() for one in psutil.Process().net_connections("tcp"))

            deadline = time.monotonic() + TIMEOUT_S
            for wanted in (True, False):
                while is_served() != wanted:
                    assert time.monotonic() < deadline
                    await asyncio.sleep(0.05)


async def test_an_answer_may_take_longer_than_its_request() -> None:
    limits = HttpLimits(header_s=1, body_s=1, idle_s=1)
    go_on = asyncio.Event()

    async def parts() -> AsyncIterator[bytes]:
        yield b"first"
        await go_on.wait()
        yield b"second"

    app = StreamingResponse(parts(), headers={"Content-Length": "11"})
    async with serve_http(app, HERE, limits) as port, connected(port) as streaming, connected(port) as later:
        streaming.say(ASK)
        await streaming.reader.readuntil(b"first")
        later.say(b"GET")  # due later than the first one's
        assert (await later.answer()).status == 408
        go_on.set()
        assert await streaming.reader.readexactly(6) == b"second"


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    socket = WebSocket(scope, receive, send)
    await socket.accept()
    while True:
        await socket.send_text(await socket.receive_text())


BROKEN = b"POST / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"


@pytest.mark.parametrize("waits", [True, False], ids=["reads the body", "does not"])
async def test_a_broken_chunk_is_refused_once_and_the_application_answers_into_the_void(
    waits: bool, caplog: pytest.LogCaptureFixture
) -> None:
    done: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        try:
            while waits and (await receive())["type"] == "http.request":
                pass
            await Response("nothing here", 404)(scope, receive, send)
        except Exception as error:
            done.set_exception(error)
        else:
            done.set_result(None)

    async with serve_http(app, HERE, HttpLimits()) as port, connected(port) as client:
        client.say(BROKEN + b"-1\r\nx\r\n")
        answer = await client.answer()
        assert (answer.status, answer.problem) == (400, "tigas:invalid-request")
        assert await client.ended() == b""
        await asyncio.wait_for(done, LONG_S)
    assert caplog.records == []


async def test_a_broken_chunk_after_the_answer_ends_the_connection(caplog: pytest.LogCaptureFixture) -> None:
    async with serve_http(Response("nothing here", 404), HERE, HttpLimits()) as port, connected(port) as client:
        client.say(BROKEN)
        assert (await client.answer()).status == 404
        client.say(b"-1\r\nx\r\n")
        assert await client.ended() == b""
    assert caplog.records == []


async def test_a_websocket_has_to_complete_its_handshake_and_then_may_stay() -> None:
    async with (
        serve_http(echo, HERE, HttpLimits(header_s=1, body_s=1, idle_s=1), websockets=True) as port,
        connect(f"ws://127.0.0.1:{port}/") as complete,
        connected(port) as client,
    ):
        client.say(b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n")
        assert (await client.answer()).problem == "tigas:request-timeout"
        assert await client.ended() == b""
        await complete.send("still here?")  # longer than the other's handshake was waited for
        assert await complete.recv() == "still here?"


async def test_a_request_arrives_when_its_head_has_been_read() -> None:
    began = asyncio.Event()
    arrivals: list[float] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        began.set()
        await takes_the_body(scope, receive, send)
        arrivals.append(scope["state"][ARRIVAL_KEY])

    async with serve_http(app, HERE, HttpLimits()) as port, connected(port) as client:
        before = time.monotonic()
        client.say(POST % 4)
        await began.wait()
        head_read = time.monotonic()
        client.say(b"body")
        await client.answer()
    assert before <= arrivals[0] <= head_read


async def test_a_request_that_is_cut_when_the_service_stops_is_answered_503() -> None:
    began = asyncio.Event()

    async def endless(scope: Scope, receive: Receive, send: Send) -> None:
        began.set()
        await asyncio.Event().wait()

    async with AsyncExitStack() as service:
        port = await service.enter_async_context(serve_http(endless, Address("127.0.0.1", 0), HttpLimits()))
        async with connected(port) as client:
            client.say(ASK)
            await began.wait()
            await service.aclose()
            answer = await client.answer()
    assert (answer.status, answer.problem) == (503, "tigas:overloaded")
