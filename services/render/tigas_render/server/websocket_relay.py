"""Hands a WebSocket on to another service, message by message."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.http11 import Response as Refusal
from websockets.typing import Origin

from tigas_common.proxy import HOP_BY_HOP, forwarded

OPEN_S, CLOSE_S = 10.0, 1.0
"""For the service to take the socket, and to let it go."""
NORMAL, NO_CODE, SERVICE_LOST = 1000, 1005, 1014
"""Close codes (RFC 6455, 7.4.1): normal; without a code; the gateway's service is down."""


async def relay(address: tuple[str, int], scope: Scope, receive: Receive, send: Send) -> None:
    """Relay messages until one side closes the socket, and close the other. A refusal is relayed unchanged.

    Raises OSError if the service at `address` does not answer.
    """
    headers, socket = Headers(scope=scope), WebSocket(scope, receive, send)
    query = scope["query_string"]
    target = (scope["raw_path"] + (b"?" + query if query else b"")).decode("ascii")
    told = [(name, value) for name, value in headers.items() if name.startswith("sec-fetch-")]
    told += [(name.decode(), value.decode()) for name, value in forwarded(scope)]
    origin = headers.get("origin")
    try:
        service = await connect(
            f"ws://{headers['host']}{target}",  # as the browser called it, at its own address
            host=address[0],
            port=address[1],
            origin=None if origin is None else Origin(origin),
            additional_headers=told,
            compression=None,
            proxy=None,
            open_timeout=OPEN_S,
            close_timeout=CLOSE_S,
        )
    except InvalidStatus as refused:
        await _handed_on(refused.response)(scope, receive, send)
    except WebSocketException as error:
        raise ConnectionError(str(error)) from None
    else:
        async with service:
            await _carry(socket, service)


async def _carry(socket: WebSocket, service: ClientConnection) -> None:
    with suppress(RuntimeError, WebSocketDisconnect):  # the client has just left
        await socket.accept()
        directions = [asyncio.create_task(_up(socket, service)), asyncio.create_task(_down(socket, service))]
        try:
            await asyncio.wait(directions, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in directions:
                task.cancel()
            await asyncio.gather(*directions, return_exceptions=True)
        if socket.client_state is WebSocketState.CONNECTED:
            await socket.close(*_end(service))


async def _up(socket: WebSocket, service: ClientConnection) -> None:
    while (message := await socket.receive())["type"] == "websocket.receive":
        text = message.get("text")
        await service.send(message["bytes"] if text is None else text)


async def _down(socket: WebSocket, service: ClientConnection) -> None:
    async for message in service:
        if isinstance(message, str):
            await socket.send_text(message)
        else:
            await socket.send_bytes(message)


def _end(service: ClientConnection) -> tuple[int, str]:
    """Why the service has closed the socket."""
    received = service.protocol.close_rcvd
    if received is None:
        return SERVICE_LOST, "The service does not answer any more."
    return NORMAL if received.code == NO_CODE else received.code, received.reason


def _handed_on(refusal: Refusal) -> Response:
    headers = {name: value for name, value in refusal.headers.raw_items() if name.lower().encode() not in HOP_BY_HOP}
    headers.pop("date", None)
    return Response(bytes(refusal.body), refusal.status_code, headers)
