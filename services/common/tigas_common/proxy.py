"""Hands HTTP requests on to another server of ours, and its answers back as they come."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, Collection

import httpx
from starlette.types import Receive, Scope, Send

from tigas_common.errors import TigasError
from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.web import error_response

Headers = list[tuple[bytes, bytes]]

HOP_BY_HOP = frozenset(
    (b"connection", b"expect", b"keep-alive", b"proxy-connection", b"te", b"transfer-encoding", b"upgrade")
)
OWN_WORDS = frozenset((b"forwarded", b"x-forwarded-for", b"x-forwarded-proto"))
"""Fields of a request that are written anew: whose request it is, is not for the client to say."""
TIMEOUTS_S = {"connect": 1.0, "write": 10.0, "pool": 5.0, "read": None}
"""A large scene takes minutes to load before the answer begins."""


async def ask(
    transport: httpx.AsyncBaseTransport,
    url: str,
    scope: Scope,
    body: bytes | AsyncIterable[bytes],
    left_out: Collection[bytes] = (),
    silence_s: float | None = None,
) -> httpx.Response:
    """The answer to a client's request of the server at `url`, its base. Who asked, the server is told.

    body: whole, or in parts as they come. left_out: fields that it does not get, in small letters. silence_s: for how
    long it may say nothing, before or within its answer. Whoever gets the answer closes it.
    Raises httpx.TransportError if there is none.
    """
    written = HOP_BY_HOP | OWN_WORDS | ({b"content-length"} if isinstance(body, bytes) else frozenset())
    headers = [each for each in scope["headers"] if each[0] not in written and each[0] not in left_out]
    headers += forwarded(scope)
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


def forwarded(scope: Scope) -> Headers:
    """The fields that say whose request it is."""
    headers = [(b"x-forwarded-proto", scope["scheme"].encode())]
    if scope["client"]:
        headers.append((b"x-forwarded-for", scope["client"][0].encode()))
    return headers


def headers_of(answer: httpx.Response) -> Headers:
    """An answer's headers, as they are handed back: names are in small letters."""
    headers = [(name.lower(), value) for name, value in answer.headers.raw]
    return [each for each in headers if each[0] not in HOP_BY_HOP and each[0] != b"date"]


async def hand_back(answer: httpx.Response, headers: Headers, receive: Receive, send: Send) -> None:
    """Send an answer, with these headers, as it comes, until the client leaves. What is left of its body is dropped."""
    leaving = asyncio.create_task(until_left(receive))
    try:
        await send({"type": "http.response.start", "status": answer.status_code, "headers": headers})
        async for part in answer.aiter_raw():
            if leaving.done():  # from now on `send` takes anything at once, of which there may be gigabytes
                return
            await send({"type": "http.response.body", "body": part, "more_body": True})
        await send({"type": "http.response.body", "body": b""})
    finally:
        leaving.cancel()
        await answer.aclose()


async def until_left(receive: Receive) -> None:
    """Wait until a client has left, whose body nobody reads any more."""
    while (await receive())["type"] != "http.disconnect":
        pass


async def refuse(error: TigasError, origins: OriginPolicy, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with an error of our own, as far as the page that asked may read it."""
    await OriginCheck(error_response(error), origins)(scope, receive, send)
