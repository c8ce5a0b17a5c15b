"""Other services under this one's origin: what is asked below `/services/NAME/` is handed on to them.

A page over HTTPS may use nothing over plain HTTP, and one on another machine may reach no port but this one. Services
see the browser's own Host, Origin and Sec-Fetch fields, so that their rules hold as if they were asked directly, after
this service's.
"""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager

import httpx
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, Request
from starlette.types import ASGIApp, Receive, Scope, Send

from tigas_common.errors import Overloaded, ServiceAway, ServiceSilent, TigasError, UnknownService
from tigas_common.origins import OriginPolicy
from tigas_common.peers import client_network
from tigas_common.proxy import ask, hand_back, headers_of, refuse, until_left
from tigas_common.topology import SERVICES_PATH, ServiceName
from tigas_render.websocket_relay import relay

TITLES: Mapping[ServiceName, str] = {
    "dash": "DASH packager",
    "shaper": "network shaper",
    "store": "experiment store",
}
"""As they are called in a sentence."""
MOST, MOST_PER_ADDRESS = 96, 48
"""Requests to a service at a time: in all, fewer than it takes connections of one address, and of one client."""
SILENCE_S = 120.0
"""A service that says nothing for so long is given up: it takes a minute for a large scene, or a report."""
IDLE_S = 2.0
"""How long a connection is kept for another request: shorter than services keep it."""


class Upstreams:
    """An ASGI application around another one, which has all paths but those of the services."""

    def __init__(
        self, app: ASGIApp, urls: Mapping[ServiceName, str], origins: OriginPolicy, processes: int = 1
    ) -> None:
        """urls: base URLs. origins: which pages may ask at all. processes: how many do this, each for its part."""
        self._app = app
        self._origins = origins
        prefix = f"{SERVICES_PATH}/".encode()
        self._services = {prefix + name.encode(): _Service(name, url, processes) for name, url in urls.items()}

    @classmethod
    @asynccontextmanager
    async def around(
        cls, app: ASGIApp, urls: Mapping[ServiceName, str], origins: OriginPolicy, processes: int = 1
    ) -> AsyncIterator[ASGIApp]:
        """One for as long as the context lasts."""
        made = cls(app, urls, origins, processes)
        try:
            yield made
        finally:
            for service in made._services.values():
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
            await service.answer(rest, prefix, receive, send)
        except TigasError as error:
            await refuse(error, self._origins, scope, receive, send)


class _Service:
    """One of them."""

    def __init__(self, name: ServiceName, url: str, processes: int) -> None:
        self._title = TITLES[name]
        self._url = httpx.URL(url)
        self._most, self._most_per_address = math.ceil(MOST / processes), math.ceil(MOST_PER_ADDRESS / processes)
        self._transport = httpx.AsyncHTTPTransport(
            limits=httpx.Limits(max_connections=self._most, keepalive_expiry=IDLE_S)
        )
        self._asking: Counter[str] = Counter()
        """How many requests of each client it is asked."""

    async def close(self) -> None:
        await self._transport.aclose()

    async def answer(self, scope: Scope, prefix: bytes, receive: Receive, send: Send) -> None:
        """Hand a request on. Raises Overloaded, ServiceAway and ServiceSilent before the answer has begun."""
        with self._counted(scope):
            if scope["type"] == "websocket":
                with self._explained():
                    await relay((self._url.host, self._url.port or 80), scope, receive, send)
            elif (answer := await self._ask(scope, receive)) is not None:
                await hand_back(answer, _located(headers_of(answer), prefix), receive, send)

    async def _ask(self, scope: Scope, receive: Receive) -> httpx.Response | None:
        """Its answer, or None if the client leaves before there is one."""
        sent = asyncio.Event()
        body = b"" if scope["method"] in ("GET", "HEAD") else _parts(Request(scope, receive), sent)
        if isinstance(body, bytes):
            sent.set()

        async def left() -> None:
            await sent.wait()
            await until_left(receive)

        asking = asyncio.create_task(ask(self._transport, str(self._url), scope, body, silence_s=SILENCE_S))
        leaving = asyncio.create_task(left())
        try:
            with self._explained():
                await asyncio.wait((asking, leaving), return_when=asyncio.FIRST_COMPLETED)
                return asking.result() if asking.done() else None
        except ClientDisconnect:
            return None
        finally:
            asking.cancel()
            leaving.cancel()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turns what goes wrong on the way into a sentence."""
        try:
            yield
        except httpx.ReadTimeout:
            raise ServiceSilent(f"The {self._title} has said nothing for {SILENCE_S:.0f} s.") from None
        except (httpx.TransportError, OSError):
            raise ServiceAway(f"The {self._title} does not answer; it may be starting, so try again.") from None

    @contextmanager
    def _counted(self, scope: Scope) -> Iterator[None]:
        client = client_network(scope["client"][0]) if scope["client"] else ""
        if self._asking.total() >= self._most or self._asking[client] >= self._most_per_address:
            raise Overloaded(f"The {self._title} is asked for too much at a time; try again later.")
        self._asking[client] += 1
        try:
            yield
        finally:
            self._asking[client] -= 1
            if not self._asking[client]:
                del self._asking[client]


async def _parts(request: Request, sent: asyncio.Event) -> AsyncIterator[bytes]:
    """A request's body as it comes. Raises ClientDisconnect."""
    async for part in request.stream():
        if part:
            yield part
    sent.set()


def _located(headers: list[tuple[bytes, bytes]], prefix: bytes) -> list[tuple[bytes, bytes]]:
    """The headers of an answer, with the path that they name as the client knows it."""
    return [(name, prefix + value if name == b"location" else value) for name, value in headers]
