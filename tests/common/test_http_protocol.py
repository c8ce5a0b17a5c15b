"""Time limits of requests, for all services alike."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator

import pytest
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket
from websockets.asyncio.client import connect

from tests.common.raw_client import ASK, Answer, connected
from tigas_common.address import Address
from tigas_common.http_limits import HttpLimits
from tigas_common.peers import ARRIVED
from tigas_common.runner import serve_http

pytestmark = pytest.mark.anyio
HERE = Address("127.0.0.1", 0)
LONG_S = 60
BODY_S = 0.2
POST = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n"


async def takes_the_body(scope: Scope, receive: Receive, send: Send) -> None:
    """Says how much it got."""
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


async def test_a_client_does_not_pay_for_an_application_that_is_late() -> None:
    limits, size = HttpLimits(body_s=BODY_S), 500_000
    async with serve_http(late, HERE, limits) as port, connected(port) as client:
        client.say(POST % size + bytes(size))
        assert await client.answer() == Answer(200, str(size).encode())


async def test_an_application_that_is_late_does_not_wait_for_ever_either() -> None:
    limits, size = HttpLimits(body_s=BODY_S), 500_000
    async with serve_http(late, HERE, limits) as port, connected(port) as client:
        client.say(POST % size + bytes(size - 1))
        assert (await client.answer()).problem == "tigas:request-timeout"


async def test_a_body_that_nobody_wanted_is_not_waited_for_either() -> None:
    limits = HttpLimits(body_s=0.2, idle_s=LONG_S, header_s=LONG_S)
    async with serve_http(Response("early"), HERE, limits) as port, connected(port) as client:
        client.say(POST % 1000 + b"x")
        assert (await client.answer()).body == b"early"
        assert await client.ended() == b""


async def test_a_connection_on_which_nothing_was_said_ends_without_a_word() -> None:
    async with serve_http(Response("ok"), HERE, HttpLimits(header_s=0.2)) as port, connected(port) as client:
        assert await client.ended() == b""


async def test_the_second_requests_headers_are_waited_for_no_longer_than_the_firsts() -> None:
    limits = HttpLimits(header_s=0.3, idle_s=LONG_S)
    async with serve_http(Response("ok"), HERE, limits) as port, connected(port) as client:
        client.say(ASK)
        assert (await client.answer()).status == 200
        client.say(b"G")
        assert (await client.answer()).problem == "tigas:request-timeout"
        assert await client.ended() == b""


async def test_an_answer_may_take_longer_than_its_request() -> None:
    limits = HttpLimits(header_s=0.2, body_s=0.2, idle_s=1)
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
    """A WebSocket that echoes."""
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
        serve_http(echo, HERE, HttpLimits(header_s=0.3, body_s=0.3, idle_s=1), websockets=True) as port,
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
        arrivals.append(scope["state"][ARRIVED])

    async with serve_http(app, HERE, HttpLimits()) as port, connected(port) as client:
        before = time.monotonic()
        client.say(POST % 4)
        await began.wait()
        head_read = time.monotonic()
        client.say(b"body")
        await client.answer()
    assert before <= arrivals[0] <= head_read
