"""HTTP/3 requests reach the ASGI application and its answers return, despite faults on either side."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

import pytest
from starlette.responses import StreamingResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from tests.render.transport.client import CERTIFICATE, Client, Recorder, connect
from tigas_common.web import ARRIVED
from tigas_render.admission.limits import Limits
from tigas_render.transport.server import Http3Server

pytestmark = pytest.mark.anyio


@asynccontextmanager
async def served(app: ASGIApp, limits: Limits | None = None) -> AsyncIterator[tuple[Http3Server, Client]]:
    async with (
        Http3Server(app, host="127.0.0.1", certificate=CERTIFICATE, limits=limits) as server,
        connect(server.port) as client,
    ):
        yield server, client


async def whole_body(receive: Receive) -> bytes:
    body = bytearray()
    while True:
        message = await receive()
        assert message["type"] == "http.request"
        body += message["body"]
        if not message["more_body"]:
            return bytes(body)


async def answer(send: Send, body: bytes, status: int = 200) -> None:
    headers = [(b"content-type", b"text/plain"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    await answer(send, await whole_body(receive))


async def test_a_request_arrives_when_the_kernel_gets_the_datagram_that_completes_it() -> None:
    arrivals: list[float] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await whole_body(receive)
        arrivals.append(scope["state"][ARRIVED])
        await answer(send, b"")

    async with served(app) as (_, client):
        stream = client.open_request("POST", "/")
        await client.ping()
        before = time.monotonic()
        client.h3.send_data(stream, b"body", end_stream=True)
        client.transmit()
        sent = time.monotonic()  # and the server has not run since
        await client.response(stream)
    assert before <= arrivals[0] <= sent


async def test_the_scope_says_what_was_asked() -> None:
    scopes: list[Scope] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        scopes.append(scope)
        await answer(send, b"hello")

    async with served(app) as (server, client):
        response = await client.fetch("GET", "/sc%C3%A9nes/a%20b?scan=1&x=%20", headers=[(b"accept", b"*/*")])
        assert (response.status, bytes(response.body), response.ended) == (200, b"hello", True)
        assert response.headers[b"content-length"] == b"5"
        (scope,) = scopes
        assert scope["client"] == client.address
        assert scope["server"] == ("127.0.0.1", server.port)
    assert scope["type"] == "http"
    assert scope["asgi"] == {"version": "3.0", "spec_version": "2.3"}
    assert scope["http_version"] == "3"
    assert scope["method"] == "GET"
    assert scope["scheme"] == "https"
    assert scope["path"] == "/scénes/a b"
    assert scope["raw_path"] == b"/sc%C3%A9nes/a%20b"
    assert scope["query_string"] == b"scan=1&x=%20"
    assert scope["root_path"] == ""
    assert scope["headers"] == [(b"host", b"localhost"), (b"accept", b"*/*")]


@pytest.mark.parametrize("size", [0, 1, 5000, 200_000])
async def test_bodies_travel_both_ways(size: int) -> None:
    body = bytes(range(256)) * (size // 256 + 1)
    async with served(echo) as (_, client):
        response = await client.fetch("POST", "/", body[:size])
    assert response.status == 200
    assert response.body == body[:size]


async def test_request_and_response_stream_at_the_same_time() -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        more = True
        while more:
            message = await receive()
            more = message["more_body"]
            await send({"type": "http.response.body", "body": message["body"].upper(), "more_body": more})

    async with served(app) as (_, client):
        stream = client.open_request("POST", "/")
        for part in (b"one", b"two", b"three"):
            response = client.responses[stream]
            whole = bytes(response.body) + part.upper()
            client.h3.send_data(stream, part, end_stream=False)
            client.transmit()
            await client.until(partial(response.body.startswith, whole))
        client.h3.send_data(stream, b"", end_stream=True)
        client.transmit()
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
        headers = [(b"Connection", b"close"), (b"Transfer-Encoding", b"chunked"), (b"X-Kept", b"1")]
        await send({"type": "http.response.start", "status": 204, "headers": headers})
        await send({"type": "http.response.body"})

    async with served(app) as (_, client):
        response = await client.fetch("GET", "/")
    assert response.headers == {b":status": b"204", b"x-kept": b"1"}


async def test_a_failing_application_is_a_500_and_a_log_line(caplog: pytest.LogCaptureFixture) -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == "/late":
            await send({"type": "http.response.start", "status": 200, "headers": []})
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
        caplog.clear()
        late = await client.fetch("GET", "/late")
    assert not late.ended
    assert late.reset is not None, "a broken answer must not look like a complete one"


async def test_cancelling_a_request_disconnects_the_application() -> None:
    seen = Recorder()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        seen.add("started")
        await whole_body(receive)
        seen.add((await receive())["type"])
        await answer(send, b"nobody hears this")
        seen.add("done")

    async with served(app) as (_, client):
        stream = client.request("POST", "/", b"x")
        await seen.until("started")
        client.stop(stream)
        await seen.until("done")
        assert "http.disconnect" in seen.events


async def test_a_client_that_goes_disconnects_the_application() -> None:
    seen = Recorder()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await whole_body(receive)
        seen.add("started")
        seen.add((await receive())["type"])

    async with served(app) as (_, client):
        client.request("GET", "/")
        await seen.until("started")
        client.close()
        await seen.until("http.disconnect")


async def test_an_answer_without_an_end_ends_when_its_client_leaves() -> None:
    seen = Recorder()

    async def parts() -> AsyncIterator[bytes]:
        while True:
            yield b"part"
            await asyncio.sleep(0)

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await StreamingResponse(parts())(scope, receive, send)
        seen.add("ended")

    async with served(app) as (_, client):
        stream = client.request("GET", "/")
        await client.until(lambda: client.responses[stream].body)
        client.stop(stream)
        await seen.until("ended")


async def test_after_its_answer_the_application_hears_of_the_disconnect() -> None:
    seen = Recorder()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await answer(send, b"done")
        seen.add((await receive())["type"])

    async with served(app) as (_, client):
        await client.fetch("GET", "/")
        await seen.until("http.disconnect")


async def test_a_body_that_nobody_reads_is_cut() -> None:
    release = asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["method"] == "POST":
            await release.wait()
            assert (await receive())["type"] == "http.disconnect"
        else:
            await answer(send, b"ok")

    async with served(app, Limits(unread=10_000)) as (_, client):
        stream = client.open_request("POST", "/")
        client.h3.send_data(stream, bytes(60_000), end_stream=False)
        client.transmit()
        await client.until(lambda: client.responses[stream].stopped is not None)
        assert (await client.response(stream)).reset is not None
        release.set()
        assert (await client.fetch("GET", "/")).status == 200


async def test_a_body_that_trickles_is_cut() -> None:
    seen = Recorder()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await receive()
        seen.add((await receive())["type"])

    async with served(app, Limits(request_timeout=0.05)) as (_, client):
        stream = client.open_request("POST", "/")
        client.h3.send_data(stream, b"{", end_stream=False)
        client.transmit()
        await seen.until("http.disconnect")
        assert (await client.response(stream)).reset is not None


async def test_too_many_requests_of_one_connection_are_refused() -> None:
    release = asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await release.wait()
        await answer(send, b"ok")

    async with served(app, Limits(requests=3)) as (server, client):
        waiting = [client.request("GET", "/") for _ in range(3)]
        refused = await client.fetch("GET", "/")
        assert refused.status == 503
        assert json.loads(refused.body)["detail"]
        async with connect(server.port) as other:
            stream = other.request("GET", "/")
            release.set()
            assert (await other.response(stream)).status == 200, "another client has its own limit"
        for stream in waiting:
            assert (await client.response(stream)).status == 200
        assert (await client.fetch("GET", "/")).status == 200


async def test_a_client_that_stops_reading_holds_up_nobody_and_takes_no_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Flow control stops the answer; the application waits in `send` and is let go when the client has stalled."""
    sent = Recorder()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == "/small":
            await answer(send, b"ok")
            return
        await send({"type": "http.response.start", "status": 200, "headers": []})
        for _ in range(1000):
            await send({"type": "http.response.body", "body": bytes(20_000), "more_body": True})
            sent.add("part")
        sent.add("all")

    limits = Limits(unsent=100_000, stall_timeout=0.5)
    async with served(app, limits) as (server, client), connect(server.port, max_stream_data=50_000) as deaf:
        monkeypatch.setattr(deaf._quic, "_write_stream_limits", lambda **_: None)
        stream = deaf.request("GET", "/large")
        await deaf.until(lambda: len(deaf.responses[stream].body) > 45_000)
        for _ in range(5):
            assert (await client.fetch("GET", "/small")).status == 200
        assert (await deaf.fetch("GET", "/small")).status == 200, "its other streams go on"
        assert sent.events.count("part") < 20, "no more than the limit waits"
        assert (await deaf.response(stream)).reset is not None
        await sent.until("all")  # the remainder is dropped


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
        assert connection._quic.unsent_total()[1] <= 130_000
        assert (await client.fetch("GET", "/")).status == 200


async def test_connect_without_webtransport_and_odd_methods() -> None:
    methods: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        methods.append(scope["method"])
        await answer(send, b"no", 405)

    async with served(app) as (_, client):
        assert (await client.fetch("CONNECT", "/")).status == 501
        assert (await client.fetch("BREW", "/")).status == 405
    assert methods == ["BREW"]
