"""Proxied services under this one's origin, between real servers: forwarded and refused requests."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.utils import accept_key

from tests.every_service import SERVICES
from tests.test_foreign_pages import EVIL, IMAGE, NOBODY, REBOUND, REQUESTS, attacks
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.origins import OriginPolicy
from tigas_common.runner import serve_http
from tigas_common.topology import ServiceName
from tigas_common.web import created_response
from tigas_experiments.wire.store import ExperimentCreated
from tigas_render.server import upstreams
from tigas_render.server.upstreams import SERVICE_LOST, UpstreamProxy

pytestmark = pytest.mark.anyio
HERE = Address("127.0.0.1", 0)
PAGE = "http://localhost:8443"
ANY_PAGE = OriginPolicy(pages=(EVIL["Origin"], NOBODY["Origin"]), hosts=frozenset({"evil.example"}))
"""A front without restrictions, so that only the service's own rules apply."""


@dataclass
class Behind:
    """A service with something of everything."""

    go_on: asyncio.Event = field(default_factory=asyncio.Event)
    cut: asyncio.Event = field(default_factory=asyncio.Event)
    received: list[bytes] = field(default_factory=list)

    def app(self) -> ASGIApp:
        return Starlette(
            routes=[
                Route("/told", self.told, methods=["GET", "POST"]),
                Route("/growing", self.growing),
                Route("/upload", self.upload, methods=["PUT"]),
                Route("/refusing", self.refusing, methods=["PUT"]),
                Route("/made", self.made, methods=["POST"]),
                WebSocketRoute("/echo", self.echo),
            ]
        )

    async def told(self, request: Request) -> Response:
        headers = [(name.decode(), value.decode()) for name, value in request.scope["headers"]]
        target = request.scope["raw_path"].decode() + "?" + request.scope["query_string"].decode()
        assert request.client
        return JSONResponse({"target": target, "headers": dict(headers), "client": request.client.host})

    async def growing(self, request: Request) -> Response:
        async def parts() -> AsyncIterator[bytes]:
            yield b"first"
            await self.go_on.wait()
            yield b"last"

        return StreamingResponse(parts())

    async def upload(self, request: Request) -> Response:
        try:
            async for part in request.stream():
                self.received.append(part)
                self.go_on.set()
        except Exception:
            self.cut.set()
            raise
        return JSONResponse({"bytes": sum(map(len, self.received)), "length": request.headers.get("content-length")})

    async def refusing(self, request: Request) -> Response:
        return Response("too large", 413)

    async def made(self, request: Request) -> Response:
        return created_response(ExperimentCreated(id="one"), "/experiments/one")

    async def echo(self, socket: WebSocket) -> None:
        await socket.accept()
        try:
            while (text := await socket.receive_text()) != "enough":
                await socket.send_text(text)
        except WebSocketDisconnect as left:
            self.received.append(str(left.code).encode())
            self.cut.set()
        else:
            await socket.close(4001, "The stream has ended.")


@asynccontextmanager
async def serving(app: ASGIApp) -> AsyncIterator[str]:
    async with serve_http(app, HERE, HttpLimits(), websockets=True) as port:
        yield f"http://127.0.0.1:{port}"


@asynccontextmanager
async def behind(
    url: str, name: ServiceName = "dash", origins: OriginPolicy | None = None
) -> AsyncIterator[httpx.AsyncClient]:
    """A client of a front before a service."""
    app = UpstreamProxy.open(Response("the page"), {name: url}, origins or OriginPolicy())
    async with (
        app as front,
        serving(front) as base,
        httpx.AsyncClient(base_url=base, trust_env=False, timeout=20) as http,
    ):
        yield http


@pytest.fixture
def service() -> Behind:
    return Behind()


@pytest.fixture
async def front(service: Behind) -> AsyncIterator[httpx.AsyncClient]:
    async with serving(service.app()) as url, behind(url) as http:
        yield http


def socket(http: httpx.AsyncClient, path: str, origin: str | None = PAGE) -> connect:
    address = {"host": http.base_url.host, "port": http.base_url.port}
    return connect(f"ws://localhost:8443{path}", origin=origin, proxy=None, **address)  # type: ignore[arg-type]


async def test_a_service_sees_the_browser_and_its_own_paths(front: httpx.AsyncClient) -> None:
    fields = {"Host": "localhost:8443", "Origin": PAGE, "Sec-Fetch-Site": "same-origin", "X-Forwarded-For": "1.2.3.4"}
    somebody = httpx.AsyncHTTPTransport(local_address="127.0.0.2")
    async with httpx.AsyncClient(transport=somebody, base_url=front.base_url) as http:
        told = (await http.get("/services/dash/told?a=%2Fb", headers=fields)).json()
    assert told["target"] == "/told?a=%2Fb"
    assert told["client"] == "127.0.0.2", "a client chose its own address"
    seen = told["headers"]
    assert (seen["host"], seen["origin"], seen["sec-fetch-site"]) == ("localhost:8443", PAGE, "same-origin")
    assert (await front.get("/services/dash")).status_code == 404, "its own root, which it has not"
    for path in ("/", "/services", "/services/store/told", "/services/dashing/told", "/x/services/dash/told"):
        assert (await front.get(path)).text == "the page"
    made = await front.post("/services/dash/made")
    assert made.headers["location"] == "/services/dash/experiments/one"


async def test_an_answer_comes_as_it_grows(service: Behind, front: httpx.AsyncClient) -> None:
    async with front.stream("GET", "/services/dash/growing") as answer:
        parts = answer.aiter_raw()
        assert await anext(parts) == b"first", "before the rest is there"
        service.go_on.set()
        assert b"".join([part async for part in parts]) == b"last"


async def test_a_body_goes_up_as_it_comes_and_one_that_stops_is_none(service: Behind, front: httpx.AsyncClient) -> None:
    async def parts(*, stops: bool) -> AsyncIterator[bytes]:
        yield b"first"
        await service.go_on.wait()  # once the service has it
        if stops:
            raise ConnectionError
        yield bytes(1_000_000)

    length = {"Content-Length": "1000005"}
    answer = await front.put("/services/dash/upload", content=parts(stops=False), headers=length)
    assert answer.json() == {"bytes": 1_000_005, "length": "1000005"}
    assert (await front.put("/services/dash/refusing", content=bytes(50_000_000))).status_code == 413
    service.go_on.clear()
    with pytest.raises(ConnectionError):
        await front.put("/services/dash/upload", content=parts(stops=True), headers=length)
    await asyncio.wait_for(service.cut.wait(), 20)


async def test_a_socket_s_messages_and_its_end_come_through(service: Behind, front: httpx.AsyncClient) -> None:
    async with socket(front, "/services/dash/echo") as open_:
        for text in ("one", "two" * 5000):
            await open_.send(text)
            assert await open_.recv() == text
        await open_.send("enough")
        with pytest.raises(ConnectionClosed):
            await open_.recv()
        assert (open_.close_code, open_.close_reason) == (4001, "The stream has ended.")
    async with socket(front, "/services/dash/echo"):
        pass
    await asyncio.wait_for(service.cut.wait(), 20)
    assert service.received == [b"1000"]
    assert await refusal(socket(front, "/services/dash/nothing")) == 403, "as Starlette refuses what has no route"
    assert await refusal(socket(front, "/elsewhere")) == 404


async def refusal(opening: connect) -> int:
    """The status with which a socket is refused."""
    with pytest.raises(InvalidStatus) as refused:
        await opening
    return int(refused.value.response.status_code)


@pytest.mark.parametrize("front_policy", [OriginPolicy(), ANY_PAGE])
async def test_a_foreign_page_gets_no_further_than_directly(front_policy: OriginPolicy, tmp_path: Path) -> None:
    """Neither where the front refuses it, nor where only the service does."""
    async with SERVICES["dash"](tmp_path) as app, serving(app) as url, behind(url, "dash", front_policy) as http:
        for method, path in (line.split() for line in REQUESTS["dash"]):
            for headers, status in attacks(method):
                sent = {"Host": "localhost:8443", **headers}
                answer = await http.request(method, f"/services/dash{path}", headers=sent)
                assert answer.status_code == status, (method, path, headers)
                assert "access-control-allow-origin" not in answer.headers
        page = {"Host": "localhost:8443", "Origin": "http://localhost:8443"}
        allowed = await http.get("/services/dash/healthz", headers=page)
        assert allowed.status_code == 200
        assert allowed.headers["content-security-policy"].count("frame-ancestors") == 1
        assert await refusal(socket(http, "/services/dash/sessions/a/poses", EVIL["Origin"])) == 403
        async with socket(http, "/services/dash/sessions/a/poses") as own:
            with pytest.raises(ConnectionClosed):
                await own.recv()
            assert own.close_code == 4004, "there is no such session"


async def test_a_page_that_this_service_refuses_asks_no_other(front: httpx.AsyncClient) -> None:
    """Even if that one has no rules."""
    for headers, status in ((EVIL, 403), (REBOUND, 421), (IMAGE, 403)):
        assert (await front.get("/services/dash/told", headers=headers)).status_code == status
    assert await refusal(socket(front, "/services/dash/echo", EVIL["Origin"])) == 403


async def test_a_service_that_is_away_is_named(service: Behind) -> None:
    async with serving(service.app()) as url:
        pass  # its port is free from now on
    async with behind(url, "store") as http:
        answer = await http.get("/services/store/told", headers={"Origin": "http://localhost:1"})
        assert (answer.status_code, answer.json()["type"]) == (502, "tigas:service-away")
        assert answer.json()["detail"] == "The experiment store does not answer; it may be starting, so try again."
        assert answer.headers["access-control-allow-origin"] == "http://localhost:1", "the page may read why"
        assert (await http.put("/services/store/upload", content=bytes(1_000_000))).status_code == 502
        assert await refusal(socket(http, "/services/store/echo")) == 502
        assert (await http.get("/")).text == "the page"


async def test_a_service_that_dies_takes_its_answers_and_sockets_along() -> None:
    """The connection is reset, so that a partial answer cannot pass as complete."""

    async def begin(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await reader.readuntil(b"\r\n\r\n")
        if b"Upgrade" in head:
            key = next(line.split(b": ")[1] for line in head.split(b"\r\n") if line.startswith(b"Sec-WebSocket-Key"))
            writer.write(b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n")
            writer.write(b"Sec-WebSocket-Accept: " + accept_key(key.decode()).encode() + b"\r\n\r\n")
        else:
            writer.write(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n5\r\nfirst\r\n")
        await writer.drain()
        await asyncio.sleep(0)
        writer.close()

    async with await asyncio.start_server(begin, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        async with behind(f"http://127.0.0.1:{port}") as http:
            with pytest.raises(httpx.RemoteProtocolError):
                await http.get("/services/dash/growing")
            async with socket(http, "/services/dash/echo") as open_:
                with pytest.raises(ConnectionClosed):
                    await open_.recv()
                assert open_.close_code == SERVICE_LOST


async def test_one_client_leaves_room_for_others(monkeypatch: pytest.MonkeyPatch, service: Behind) -> None:
    monkeypatch.setattr(upstreams, "MAX_REQUESTS_PER_ADDRESS", 2)
    monkeypatch.setattr(upstreams, "MAX_REQUESTS", 3)
    async with serving(service.app()) as url, behind(url) as http, AsyncExitStack() as stack:
        for _ in range(2):
            growing = await stack.enter_async_context(http.stream("GET", "/services/dash/growing"))
            await anext(growing.aiter_raw())
        refused = await http.get("/services/dash/told")
        assert (refused.status_code, refused.json()["type"]) == (503, "tigas:overloaded")
        assert await refusal(socket(http, "/services/dash/echo")) == 503
        elsewhere = httpx.AsyncHTTPTransport(local_address="127.0.0.2")
        async with httpx.AsyncClient(transport=elsewhere, base_url=http.base_url) as other:
            assert (await other.get("/services/dash/told")).status_code == 200
        service.go_on.set()
    async with serving(service.app()) as url, behind(url) as http:
        assert (await http.get("/services/dash/told")).status_code == 200


async def test_a_service_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(upstreams, "TIMEOUT_S", 0.2)

    async def hang(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read()
        writer.close()

    async with await asyncio.start_server(hang, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        async with behind(f"http://127.0.0.1:{port}", "shaper") as http:
            answer = await http.get("/services/shaper/status")
    assert (answer.status_code, answer.json()["type"]) == (504, "tigas:service-silent")
