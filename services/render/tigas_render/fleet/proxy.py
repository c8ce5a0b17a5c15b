"""Hands HTTP requests on to the engine's application over a Unix socket, and its answers back as they come."""

from __future__ import annotations

from pathlib import Path

import httpx
from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from tigas_common.errors import Overloaded, TigasError
from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.parsing import MAX_BODY
from tigas_common.web import on_error, read_body

HOP_BY_HOP = frozenset(
    (b"connection", b"expect", b"keep-alive", b"proxy-connection", b"te", b"transfer-encoding", b"upgrade")
)
OWN_WORDS = frozenset((b"content-length", b"forwarded", b"x-forwarded-for", b"x-forwarded-proto"))
"""Fields of a request that are written anew: whose request it is, is not for the client to say."""
TIMEOUTS_S = {"connect": 1.0, "write": 10.0, "pool": 5.0, "read": None}
"""A large scene takes minutes to load before the answer begins."""
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
            answer = await self._ask(scope, await read_body(Request(scope, receive), MAX_BODY))
        except TigasError as error:
            refusal = await on_error(Request(scope), error)
            await OriginCheck(refusal, self._origins)(scope, receive, send)
            return
        try:
            headers = [(name.lower(), value) for name, value in answer.headers.raw]
            headers = [each for each in headers if each[0] not in HOP_BY_HOP and each[0] != b"date"]
            await send({"type": "http.response.start", "status": answer.status_code, "headers": headers})
            async for part in answer.aiter_raw():
                await send({"type": "http.response.body", "body": part, "more_body": True})
            await send({"type": "http.response.body", "body": b""})
        finally:
            await answer.aclose()

    async def _ask(self, scope: Scope, body: bytes) -> httpx.Response:
        headers = [each for each in scope["headers"] if each[0] not in HOP_BY_HOP | OWN_WORDS]
        headers.append((b"x-forwarded-proto", scope["scheme"].encode()))
        if scope["client"]:
            headers.append((b"x-forwarded-for", scope["client"][0].encode()))
        query = scope["query_string"]
        request = httpx.Request(
            scope["method"],
            "http://engine/",
            headers=headers,
            content=body or None,
            extensions={"target": scope["raw_path"] + (b"?" + query if query else b""), "timeout": TIMEOUTS_S},
        )
        try:
            return await self._transport.handle_async_request(request)
        except httpx.TransportError as error:
            raise Overloaded(AWAY, RETRY_S) from error
