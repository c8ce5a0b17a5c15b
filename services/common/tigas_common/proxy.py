"""A streaming proxy: forwards HTTP requests to another TIGAS server, and its answers as they arrive."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, Awaitable, Collection, Coroutine
from typing import Any, TypeVar

import httpx
from starlette.types import Receive, Scope, Send

from tigas_common.address import client_network
from tigas_common.errors import TigasError
from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.web import error_response

Result = TypeVar("Result")
Headers = list[tuple[bytes, bytes]]

HOP_BY_HOP = frozenset(
    (b"connection", b"expect", b"keep-alive", b"proxy-connection", b"te", b"transfer-encoding", b"upgrade")
)
FORWARDED_HEADERS = frozenset((b"forwarded", b"x-forwarded-for", b"x-forwarded-proto"))
"""Headers about the client, which are rewritten so that clients cannot forge them."""
TIMEOUTS_S = {"connect": 1.0, "write": 10.0, "pool": 5.0, "read": None}
"""No timeout on reading, as a large scene takes minutes to load before the answer begins."""


async def forward(
    transport: httpx.AsyncBaseTransport,
    url: str,
    scope: Scope,
    body: bytes | AsyncIterable[bytes],
    left_out: Collection[bytes] = (),
    silence_s: float | None = None,
) -> httpx.Response:
    """Forward a client's request to the server at the base URL `url`, and return the answer, which the caller closes.

    body: all of it, or its parts as they arrive. left_out: lower-case names of headers to omit. silence_s: the longest
    pause before and within the answer. The server gets the client's address. Raises httpx.TransportError.
    """
    written = HOP_BY_HOP | FORWARDED_HEADERS | ({b"content-length"} if isinstance(body, bytes) else frozenset())
    headers = [each for each in scope["headers"] if each[0] not in written and each[0] not in left_out]
    headers += forwarded_headers(scope)
    query = scope["query_string"]
    request = httpx.Request(
        scope["method"],
        url,
        headers=headers,
        content=body or None,
        extensions={
            "target": scope["raw_path"] + (b"?" + query if query else b""),
            "timeout": {**TIMEOUTS_S, "read": silence_s},
        },
    )
    return await transport.handle_async_request(request)


def forwarded_headers(scope: Scope) -> Headers:
    """The headers with the client's address and scheme."""
    headers = [(b"x-forwarded-proto", scope["scheme"].encode())]
    if scope["client"]:
        headers.append((b"x-forwarded-for", scope["client"][0].encode()))
    return headers


def response_headers(answer: httpx.Response) -> Headers:
    """The headers of an answer to pass on, with lower-case names."""
    headers = [(name.lower(), value) for name, value in answer.headers.raw]
    return [each for each in headers if each[0] not in HOP_BY_HOP and each[0] != b"date"]


async def stream_response(answer: httpx.Response, headers: Headers, receive: Receive, send: Send) -> None:
    """Stream a response with these headers. If the client disconnects, discard the rest of the body."""
    disconnected = asyncio.create_task(wait_for_disconnect(receive))
    try:
        await send({"type": "http.response.start", "status": answer.status_code, "headers": headers})
        async for part in answer.aiter_raw():
            if disconnected.done():  # `send` no longer waits then, and the rest may be gigabytes
                return
            await send({"type": "http.response.body", "body": part, "more_body": True})
        await send({"type": "http.response.body", "body": b""})
    finally:
        disconnected.cancel()
        await answer.aclose()


async def run_until(end: Awaitable[object], work: Coroutine[Any, Any, Result]) -> Result | None:
    """Return the result of `work`, or cancel it and return None if `end` is done first.

    If `end` is a future, it is left alone; a coroutine is cancelled after the work.
    """
    working, ending = asyncio.create_task(work), asyncio.ensure_future(end)
    try:
        await asyncio.wait((working, ending), return_when=asyncio.FIRST_COMPLETED)
        return working.result() if working.done() else None
    except asyncio.CancelledError:
        if working.done() and not working.cancelled() and working.exception() is None:
            result = working.result()
            if isinstance(result, httpx.Response):  # nothing else will close it
                await result.aclose()
        raise
    finally:
        working.cancel()
        if ending is not end:
            ending.cancel()


def client_key(scope: Scope) -> str:
    """The network of a request's client; empty if unknown."""
    return client_network(scope["client"][0]) if scope["client"] else ""


async def wait_for_disconnect(receive: Receive) -> None:
    """Wait until the client has disconnected, and discard the rest of its body."""
    while (await receive())["type"] != "http.disconnect":
        pass


async def send_error(error: TigasError, origins: OriginPolicy, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with an error that only allowed pages may read."""
    await OriginCheck(error_response(error), origins)(scope, receive, send)
