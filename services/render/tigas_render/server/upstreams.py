"""Proxies for the other services on this service's origin, at `/services/NAME/`.

A page loaded over HTTPS may not use plain HTTP, and a page on another machine may reach only this port. The services
receive the browser's own Host, Origin and Sec-Fetch headers, and apply their own rules after this service's.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress

import httpx
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.typing import Origin

from tigas_common.errors import Overloaded, ServiceAway, ServiceSilent, TigasError, UnknownService
from tigas_common.limits import ConcurrencyLimit, share_limit
from tigas_common.origins import OriginPolicy
from tigas_common.proxy import (
    HOP_BY_HOP,
    client_key,
    forward,
    forwarded_headers,
    response_headers,
    run_until,
    send_error,
    stream_response,
    wait_for_disconnect,
)
from tigas_common.topology import SERVICES_PATH, ServiceName

TITLES: Mapping[ServiceName, str] = {
    "dash": "DASH packager",
    "shaper": "network shaper",
    "store": "experiment store",
}
"""Names of the services in error messages."""
MAX_REQUESTS, MAX_REQUESTS_PER_ADDRESS = 96, 48
"""Concurrent requests to a service: in total, which stays below the service's own limit per address, and per client."""
TIMEOUT_S = 120.0
"""Seconds to wait for an answer before giving up: a large scene, or a report, takes a minute."""
KEEPALIVE_S = 2.0
"""Seconds for which an idle connection is kept, shorter than the services keep it."""
OPEN_TIMEOUT_S, CLOSE_TIMEOUT_S = 10.0, 1.0
"""Timeouts in seconds for a service to accept a WebSocket, and to close it."""
NORMAL, NO_CODE, SERVICE_LOST = 1000, 1005, 1014
"""Close codes (RFC 6455, 7.4.1): normal closure, no code received, and bad gateway."""


class UpstreamProxy:
    """ASGI middleware that forwards the services' paths to them, and passes all others to the application."""

    def __init__(
        self, app: ASGIApp, urls: Mapping[ServiceName, str], origins: OriginPolicy, processes: int = 1
    ) -> None:
        """urls: base URLs. origins: the allowed pages. processes: the number of processes that share the limits."""
        self._app = app
        self._origins = origins
        prefix = f"{SERVICES_PATH}/".encode()
        self._services = {prefix + name.encode(): _Upstream(name, url, processes) for name, url in urls.items()}

    @classmethod
    @asynccontextmanager
    async def open(
        cls, app: ASGIApp, urls: Mapping[ServiceName, str], origins: OriginPolicy, processes: int = 1
    ) -> AsyncIterator[ASGIApp]:
        proxy = cls(app, urls, origins, processes)
        try:
            yield proxy
        finally:
            for service in proxy._services.values():
                await service.close()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        path: bytes = scope.get("raw_path", b"")
        prefix = b"/".join(path.split(b"/", 3)[:3])
        service = self._services.get(prefix)
        if service is None and scope["type"] != "websocket":
            return await self._app(scope, receive, send)
        try:
            if service is None:
                raise UnknownService("There is no WebSocket at this path.")
            self._origins.check_request(scope.get("method", "GET"), Headers(scope=scope))
            rest = {**scope, "raw_path": path.removeprefix(prefix) or b"/"}
            await service.forward(rest, prefix, receive, send)
        except TigasError as error:
            await send_error(error, self._origins, scope, receive, send)


class _Upstream:
    def __init__(self, name: ServiceName, url: str, processes: int) -> None:
        self._title = TITLES[name]
        self._url = httpx.URL(url)
        limit = math.ceil(MAX_REQUESTS / processes)
        self._running = ConcurrencyLimit(limit, min(limit, share_limit(MAX_REQUESTS_PER_ADDRESS, processes)))
        self._transport = httpx.AsyncHTTPTransport(
            limits=httpx.Limits(max_connections=limit, keepalive_expiry=KEEPALIVE_S)
        )
        self.close = self._transport.aclose

    async def forward(self, scope: Scope, prefix: bytes, receive: Receive, send: Send) -> None:
        """Forward a request. Raises Overloaded, ServiceAway and ServiceSilent before the answer has begun."""
        busy = Overloaded(f"The {self._title} is handling too many requests; try again later.")
        with self._running.acquire(client_key(scope), busy):
            if scope["type"] == "websocket":
                with self._translate_errors():
                    await _relay(self._url, scope, receive, send)
            elif (answer := await self._request(scope, receive)) is not None:
                # `Location` must be a path on this origin
                headers = [
                    (name, prefix + value if name == b"location" else value) for name, value in response_headers(answer)
                ]
                await stream_response(answer, headers, receive, send)

    async def _request(self, scope: Scope, receive: Receive) -> httpx.Response | None:
        """Return the answer, or None if the client disconnects first."""
        sent = asyncio.Event()
        body = b"" if scope["method"] in ("GET", "HEAD") else _body_chunks(Request(scope, receive), sent)
        if isinstance(body, bytes):
            sent.set()

        async def left() -> None:
            await sent.wait()
            await wait_for_disconnect(receive)

        try:
            with self._translate_errors():
                return await run_until(
                    left(), forward(self._transport, str(self._url), scope, body, silence_s=TIMEOUT_S)
                )
        except ClientDisconnect:
            return None

    @contextmanager
    def _translate_errors(self) -> Iterator[None]:
        """Turn connection errors into errors with a readable message."""
        try:
            yield
        except httpx.ReadTimeout:
            raise ServiceSilent(f"The {self._title} has not answered for {TIMEOUT_S:.0f} s.") from None
        except (httpx.TransportError, OSError):
            raise ServiceAway(f"The {self._title} does not answer; it may be starting, so try again.") from None


async def _body_chunks(request: Request, sent: asyncio.Event) -> AsyncIterator[bytes]:
    """Yield a request's body in chunks. Raises ClientDisconnect."""
    async for part in request.stream():
        if part:
            yield part
    sent.set()


async def _relay(url: httpx.URL, scope: Scope, receive: Receive, send: Send) -> None:
    """Relay a WebSocket's messages until one side closes it, then close the other. A rejection is relayed unchanged.

    Raises OSError if the service does not answer.
    """
    headers, query = Headers(scope=scope), scope["query_string"]
    target = (scope["raw_path"] + (b"?" + query if query else b"")).decode("ascii")
    about = [(name, value) for name, value in headers.items() if name.startswith("sec-fetch-")]
    about += [(name.decode(), value.decode()) for name, value in forwarded_headers(scope)]
    origin = headers.get("origin")
    try:
        service = await connect(
            f"ws://{headers['host']}{target}",  # the browser's Host, although the connection goes to `url`
            host=url.host,
            port=url.port or 80,
            origin=None if origin is None else Origin(origin),
            additional_headers=about,
            compression=None,
            proxy=None,
            open_timeout=OPEN_TIMEOUT_S,
            close_timeout=CLOSE_TIMEOUT_S,
        )
    except InvalidStatus as refused:
        answer = refused.response
        kept = {name: value for name, value in answer.headers.raw_items() if name.lower().encode() not in HOP_BY_HOP}
        kept.pop("date", None)
        await Response(bytes(answer.body), answer.status_code, kept)(scope, receive, send)
    except WebSocketException as error:
        raise ConnectionError(str(error)) from None
    else:
        async with service:
            await _relay_messages(WebSocket(scope, receive, send), service)


async def _relay_messages(socket: WebSocket, service: ClientConnection) -> None:
    with suppress(RuntimeError, WebSocketDisconnect):  # the client has just disconnected
        await socket.accept()
        directions = [
            asyncio.create_task(_relay_up(socket, service)),
            asyncio.create_task(_relay_down(socket, service)),
        ]
        try:
            await asyncio.wait(directions, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in directions:
                task.cancel()
            await asyncio.gather(*directions, return_exceptions=True)
        if socket.client_state is WebSocketState.CONNECTED:
            end = service.protocol.close_rcvd
            if end is None:
                await socket.close(SERVICE_LOST, "The service stopped answering.")
            else:
                await socket.close(NORMAL if end.code == NO_CODE else end.code, end.reason)


async def _relay_up(socket: WebSocket, service: ClientConnection) -> None:
    while (message := await socket.receive())["type"] == "websocket.receive":
        text = message.get("text")
        await service.send(message["bytes"] if text is None else text)


async def _relay_down(socket: WebSocket, service: ClientConnection) -> None:
    async for message in service:
        if isinstance(message, str):
            await socket.send_text(message)
        else:
            await socket.send_bytes(message)
