"""HTTP/3 requests reach the ASGI application and its answers return, despite faults on either side."""

from __future__ import annotations

import asyncio
import hashlib
import itertools
import json
import logging
import random
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

import pytest
from starlette.responses import StreamingResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tests.eventually import eventually
from tests.render.transport import serving
from tests.render.transport.client import Client, connect
from tigas_common.web import ARRIVAL_KEY
from tigas_render.admission.limits import Limits
from tigas_render.transport.server import Http3Server

pytestmark = pytest.mark.anyio


@asynccontextmanager
async def served(app: ASGIApp, limits: Limits | None = None) -> AsyncIterator[tuple[Http3Server, Client]]:
    async with serving.served(limits, app=app) as server, connect(server.port) as client:
        yield server, client


async def whole_body(receive: Receive) -> bytes:
    body = bytearray()
    while True:
        message = await receive()
        assert message["type"] == "http.request"
        body += message["body"]
        if not message["more_body"]:
            return bytes(body)


async def start(send: Send, status: int = 200, *headers: tuple[bytes, bytes]) -> None:
    await send({"type": "http.response.start", "status": status, "headers": headers})


async def answer(send: Send, body: bytes) -> None:
    await start(send, 200, (b"content-length", str(len(body)).encode()))
    await send({"type": "http.response.body", "body": body})


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    await answer(send, await whole_body(receive))


async def test_the_scope_says_what_was_asked_and_when_it_was_complete() -> None:
    scopes: list[Scope] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        scopes.append(scope)
        await whole_body(receive)
        await answer(send, b"hello")

    async with served(app) as (server, client):
        stream = client.open_request("POST", "/sc%C3%A9nes/a%20b?scan=1&x=%20", headers=[(b"accept", b"*/*")])
        await client.ping()
        before = time.monotonic()
        client.h3.send_data(stream, b"body", end_stream=True)
        client.transmit()
        sent = time.monotonic()  # and the server has not run since
        response = await client.response(stream)
        assert (response.status, bytes(response.body), response.ended) == (200, b"hello", True)
        assert response.headers[b"content-length"] == b"5"
        (scope,) = scopes
        assert before <= scope.pop("state")[ARRIVAL_KEY] <= sent
        assert scope == {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.3"},
            "http_version": "3",
            "method": "POST",
            "scheme": "https",
            "path": "/scénes/a b",
            "raw_path": b"/sc%C3%A9nes/a%20b",
            "query_string": b"scan=1&x=%20",
            "root_path": "",
            "headers": [(b"host", b"localhost"), (b"accept", b"*/*")],
            "client": client.address,
            "server": ("127.0.0.1", server.port),
        }


@pytest.mark.parametrize("size", [0, 1, 5000, 200_000])
async def test_bodies_travel_both_ways(size: int) -> None:
    body = (bytes(range(256)) * (size // 256 + 1))[:size]
    async with served(echo) as (_, client):
        response = await client.fetch("POST", "/", body)
    assert (response.status, bytes(response.body)) == (200, body)


async def test_request_and_response_stream_at_the_same_time() -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await start(send)
        more = True
        while more:
            message = await receive()
            more = message["more_body"]
            await send({"type": "http.response.body", "body": message["body"].upper(), "more_body": more})

    async with served(app) as (_, client):
        stream = client.open_request("POST", "/")
        response = client.responses[stream]
        for part in (b"one", b"two", b"three", b""):
            whole = bytes(response.body) + part.upper()
            client.h3.send_data(stream, part, end_stream=not part)
            client.transmit()
            await client.until(partial(response.body.startswith, whole))
        assert bytes((await client.response(stream)).body) == b"ONETWOTHREE"


async def test_head_has_headers_and_no_body(monkeypatch: pytest.MonkeyPatch) -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await answer(send, b"four")

    async with served(app) as (_, client):
        # aioquic's client does not know its own request
        monkeypatch.setattr(client.h3, "_check_content_length", lambda _: None)
        response = await client.fetch("HEAD", "/")
    assert (response.status, bytes(response.body), response.ended) == (200, b"", True)
    assert response.headers[b"content-length"] == b"4"


async def test_headers_that_http3_forbids_are_left_out() -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await start(send, 204, (b"Connection", b"close"), (b"Transfer-Encoding", b"chunked"), (b"X-Kept", b"1"))
        await send({"type": "http.response.body"})

    async with served(app) as (_, client):
        response = await client.fetch("GET", "/")
    assert response.headers == {b":status": b"204", b"x-kept": b"1"}


async def test_a_failing_application_is_a_500_and_a_log_line(caplog: pytest.LogCaptureFixture) -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == "/late":
            await start(send)
        if scope["path"] != "/silent":
            raise RuntimeError("secret")

    async with served(app) as (_, client):
        with caplog.at_level(logging.ERROR, "tigas_render"):
            response = await client.fetch("GET", "/")
        assert response.status == 500
        assert response.headers[b"content-type"] == b"application/problem+json"
        assert json.loads(response.body)["status"] == 500
        assert b"secret" not in response.body
        assert "secret" in caplog.text
        assert (await client.fetch("GET", "/silent")).status == 500
        late = await client.fetch("GET", "/late")
    assert not late.ended
    assert late.reset is not None, "a broken answer must not look like a complete one"


@pytest.mark.parametrize("how", ["the client stops reading", "the client leaves", "its answer is complete"])
async def test_the_application_is_disconnected_when(how: str) -> None:
    seen: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await whole_body(receive)
        if how == "its answer is complete":
            await answer(send, b"done")
        seen.append("started")
        seen.append((await receive())["type"])
        if how != "its answer is complete":
            await answer(send, b"nobody hears this")
        seen.append("done")

    async with served(app) as (_, client):
        stream = client.request("POST", "/", b"x")
        await eventually(lambda: seen)
        if how == "the client stops reading":
            client.stop(stream)
        elif how == "the client leaves":
            client.close()
        await eventually(lambda: seen == ["started", "http.disconnect", "done"])


async def test_an_answer_without_an_end_ends_when_its_client_leaves() -> None:
    seen: list[str] = []

    async def parts() -> AsyncIterator[bytes]:
        while True:
            yield b"part"
            await asyncio.sleep(0)

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await StreamingResponse(parts())(scope, receive, send)
        seen.append("ended")

    async with served(app) as (_, client):
        stream = client.request("GET", "/")
        await client.until(lambda: client.responses[stream].body)
        client.stop(stream)
        await eventually(lambda: seen)


async def test_a_body_that_trickles_is_cut() -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["method"] == "GET":
            await answer(send, b"ok")
        else:
            await receive()
            assert (await receive())["type"] == "http.disconnect"

    async with served(app, Limits(request_timeout=0.05)) as (_, client):
        stream = client.open_request("POST", "/")
        client.h3.send_data(stream, bytes(1), end_stream=False)
        client.transmit()
        await client.until(lambda: client.responses[stream].stopped is not None)
        assert (await client.response(stream)).reset is not None
        assert (await client.fetch("GET", "/")).status == 200


async def test_an_upload_waits_for_a_slow_reader() -> None:
    pauses = itertools.chain([0.5], itertools.repeat(0.01))

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        async def slowly() -> Message:
            await asyncio.sleep(next(pauses))
            return await receive()

        await answer(send, hashlib.sha256(await whole_body(slowly)).hexdigest().encode())

    body = random.Random(1).randbytes(3_000_000)
    async with served(app) as (_, client):
        response = await client.fetch("POST", "/", body)
    assert (response.status, response.body.decode()) == (200, hashlib.sha256(body).hexdigest())


async def test_uploads_that_nobody_reads_take_little_memory_and_hold_up_nothing() -> None:
    parts: list[int] = []
    go_on = asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["method"] == "POST":
            await go_on.wait()
        more = True
        while more:
            message = await receive()
            parts.append(len(message["body"]))
            more = message["more_body"]
        await answer(send, b"ok")

    async with served(app) as (server, client):
        uploads = [client.request("POST", "/", bytes(200_000)) for _ in range(12)]
        (connection,) = server._connections
        window = Limits().stream_window
        unread = connection._quic._unread
        await eventually(lambda: all(unread.get(stream, 0) > window - 100 for stream in uploads))
        assert (await client.fetch("GET", "/")).status == 200
        assert max(unread.values()) <= window
        go_on.set()
        assert [(await client.response(stream)).status for stream in uploads] == [200] * 12
        assert max(parts) <= window
        assert sum(parts) == 12 * 200_000
        assert not unread


async def test_an_upload_that_is_refused_early_leaves_nothing_behind() -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await asyncio.sleep(0.05)
        if scope["path"] == "/fails":
            await start(send)
            raise RuntimeError
        await answer(send, b"no")

    async with served(app) as (server, client):
        (connection,) = server._connections
        for path in ("/refuses", "/fails"):
            response = await client.fetch("POST", path, bytes(1_000_000))
            assert response.done
        await eventually(lambda: not connection._quic._unread)


async def test_too_many_requests_of_one_connection_are_refused() -> None:
    release = asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await release.wait()
        await answer(send, b"ok")

    async with served(app, Limits(requests=3)) as (server, client), connect(server.port) as other:
        waiting = [client.request("GET", "/") for _ in range(3)]
        refused = await client.fetch("GET", "/")
        assert refused.status == 503
        assert json.loads(refused.body)["detail"]
        stream = other.request("GET", "/")
        release.set()
        assert (await other.response(stream)).status == 200, "another client has its own limit"
        assert [(await client.response(stream)).status for stream in waiting] == [200] * 3
        assert (await client.fetch("GET", "/")).status == 200


async def test_a_client_that_stops_reading_holds_up_nobody_and_takes_no_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Flow control stops the answer; the application waits in `send` and is let go when the client has stalled."""
    sent: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == "/small":
            await answer(send, b"ok")
            return
        await start(send)
        for _ in range(1000):
            await send({"type": "http.response.body", "body": bytes(20_000), "more_body": True})
            sent.append("part")
        sent.append("all")

    limits = Limits(unsent=100_000, stall_timeout=0.5)
    async with served(app, limits) as (server, client), connect(server.port, max_stream_data=50_000) as deaf:
        monkeypatch.setattr(deaf._quic, "_write_stream_limits", lambda **_: None)
        stream = deaf.request("GET", "/large")
        await deaf.until(lambda: len(deaf.responses[stream].body) > 45_000)
        for _ in range(5):
            assert (await client.fetch("GET", "/small")).status == 200
        assert (await deaf.fetch("GET", "/small")).status == 200, "its other streams go on"
        assert sent.count("part") < 20, "no more than the limit waits"
        assert (await deaf.response(stream)).reset is not None
        await eventually(lambda: "all" in sent)  # the remainder is dropped


async def test_small_answers_that_nobody_reads_take_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each fits in a stream's limit, but all of them together do not fit in a connection's."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await answer(send, bytes(20_000))

    limits = Limits(unread_answers=100_000, stall_timeout=0.1)
    async with served(app, limits) as (server, client), connect(server.port, max_stream_data=1000) as deaf:
        monkeypatch.setattr(deaf._quic, "_write_stream_limits", lambda **_: None)
        streams = [deaf.request("GET", "/") for _ in range(30)]
        await deaf.until(lambda: sum(deaf.responses[stream].reset is not None for stream in streams) >= 24)
        _, connection = server._connections
        assert connection._quic.total_unsent_bytes()[1] <= 130_000
        assert (await client.fetch("GET", "/")).status == 200


async def test_large_answers_that_nobody_reads_take_no_more_memory_than_an_address_may(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await answer(send, bytes(1_500_000 if scope["path"] == "/" else 1000))

    limits = Limits(waiting_per_address=4_000_000)
    async with served(app, limits) as (server, client), connect(server.port, max_stream_data=1000) as deaf:
        monkeypatch.setattr(deaf._quic, "_write_stream_limits", lambda **_: None)
        streams = [deaf.request("GET", "/") for _ in range(8)]
        await deaf.until(lambda: sum(deaf.responses[stream].reset is not None for stream in streams) >= 5)
        (usage,) = server._connections.usage.values()
        assert 1_000_000 < usage.waiting_bytes <= 4_000_000
        assert len((await client.fetch("GET", "/short")).body) == 1000
        deaf.close()
        await eventually(lambda: usage.waiting_bytes == 0)


async def test_connect_without_webtransport_and_odd_methods() -> None:
    methods: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        methods.append(scope["method"])
        await answer(send, b"no")

    async with served(app) as (_, client):
        assert (await client.fetch("CONNECT", "/")).status == 501
        assert (await client.fetch("BREW", "/")).status == 200
    assert methods == ["BREW"]
