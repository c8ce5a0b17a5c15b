"""Hands HTTP requests on to an engine's application over a Unix socket, and its answers back as they come."""

from __future__ import annotations

from pathlib import Path

import httpx
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from tigas_common.errors import Overloaded, TigasError
from tigas_common.origins import OriginPolicy
from tigas_common.parsing import MAX_BODY
from tigas_common.proxy import ask, hand_back, headers_of, refuse
from tigas_common.web import read_body

MAX_CONNECTIONS = 256
AWAY = "The renderer is starting; try again in a second."
RETRY_S = 1.0


class EngineProxy:
    """An ASGI application, as which the engine's appears. It passes bodies of up to MAX_BODY bytes."""

    def __init__(self, path: Path, origins: OriginPolicy) -> None:
        """origins: which pages may read the answers that are its own."""
        self._transport = httpx.AsyncHTTPTransport(
            uds=str(path), limits=httpx.Limits(max_connections=MAX_CONNECTIONS, keepalive_expiry=2.0)
        )
        self._origins = origins

    async def close(self) -> None:
        """Close the connections."""
        await self._transport.aclose()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            answer = await self.ask(scope, await read_body(Request(scope, receive), MAX_BODY))
        except TigasError as error:
            await refuse(error, self._origins, scope, receive, send)
        else:
            await hand_back(answer, headers_of(answer), receive, send)

    async def ask(self, scope: Scope, body: bytes) -> httpx.Response:
        """The engine's answer, which whoever gets it closes. Raises Overloaded while the engine is gone."""
        try:
            return await ask(self._transport, "http://engine/", scope, body)
        except httpx.TransportError as error:
            raise Overloaded(AWAY, RETRY_S) from error
