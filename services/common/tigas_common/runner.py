"""Running of ASGI applications over HTTP/1.1."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import ssl
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any

import uvicorn
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tigas_common.address import Address
from tigas_common.errors import Overloaded, StartError, problem
from tigas_common.http_server import LimitedServer, Server
from tigas_common.limits import HttpLimits
from tigas_common.parsing import MAX_BODY
from tigas_common.resources import keep_releasing_memory
from tigas_common.web import problem_response

UNIX_IDLE_S = 60
"""Seconds that a connection over a Unix socket may be idle: longer than our own clients keep one for reuse."""

STOPPING = "The service is stopping."


@asynccontextmanager
async def serve_http(
    app: Any, address: Address, limits: HttpLimits, tls: ssl.SSLContext | None = None, *, websockets: bool = False
) -> AsyncIterator[int]:
    """Serve an ASGI application, as a context manager that yields the port.

    Raises OSError if the address cannot be bound. `tls` enables HTTPS; a certificate loaded into the same context later
    applies to new connections.
    """
    async with serve_listener(app, address.listen(limits.unread_s), limits, tls, websockets=websockets) as port:
        yield port


@asynccontextmanager
async def serve_listener(
    app: Any,
    listener: socket.socket,
    limits: HttpLimits,
    tls: ssl.SSLContext | None = None,
    *,
    websockets: bool = False,
) -> AsyncIterator[int]:
    """Like `serve_http`, on a listening socket that other processes may share; it is closed at the end."""
    config = uvicorn.Config(
        handle_cancelled(app),
        lifespan="off",
        log_level="critical",  # applications log their own failures, and the rest are disconnects
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=1,
        ws="websockets-sansio" if websockets else "none",
        ws_max_size=MAX_BODY,
    )
    async with _running(LimitedServer(config, limits, tls), [listener]):
        yield listener.getsockname()[1]


@asynccontextmanager
async def serve_unix(app: Any, path: Path) -> AsyncIterator[None]:
    """Serve an ASGI application on a Unix socket to our own processes, whose `X-Forwarded-For` is trusted."""
    config = uvicorn.Config(
        handle_cancelled(app),
        uds=str(path),
        lifespan="off",
        log_level="critical",
        access_log=False,
        server_header=False,
        forwarded_allow_ips="*",
        timeout_keep_alive=UNIX_IDLE_S,
        timeout_graceful_shutdown=1,
        ws="none",
    )
    async with _running(_UnixServer(config), None):
        yield


class _UnixServer(Server):
    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.started_event.set()


@asynccontextmanager
async def _running(server: Server, sockets: list[socket.socket] | None) -> AsyncIterator[None]:
    running = asyncio.create_task(server.serve(sockets))
    await asyncio.wait([running, asyncio.create_task(server.started_event.wait())], return_when=asyncio.FIRST_COMPLETED)
    if running.done():
        running.result()
    try:
        yield
    finally:
        server.should_exit = True
        with suppress(asyncio.CancelledError):
            await running


def handle_cancelled(app: ASGIApp) -> ASGIApp:
    """Wrap an application: requests cancelled by a shutdown are answered with 503 instead of uvicorn's 500."""

    async def wrapped(scope: Scope, receive: Receive, send: Send) -> None:
        started = False

        async def tracked_send(message: Message) -> None:
            nonlocal started
            started = True
            await send(message)

        try:
            await app(scope, receive, tracked_send)
        except asyncio.CancelledError:
            if started or scope["type"] != "http":
                raise
            await problem_response(problem(Overloaded(STOPPING)))(scope, receive, send)

    return wrapped


@contextmanager
def listen_errors(address: Address, flag: str) -> Iterator[None]:
    """Turn OSErrors about an address, which `flag` sets, into a StartError."""
    try:
        yield
    except (OSError, UnicodeError) as error:  # UnicodeError: an invalid host name
        number = getattr(error, "errno", None)
        reason = os.strerror(number) if number and number > 0 else str(error)
        raise StartError(f"Cannot listen on {address} ({reason}); choose another with {flag}.") from None


async def wait_for_stop() -> None:
    """Wait for SIGINT or SIGTERM, and return free memory to the system meanwhile."""
    stopped = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopped.set)
    memory = asyncio.create_task(keep_releasing_memory())
    try:
        await stopped.wait()
    finally:
        memory.cancel()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)
