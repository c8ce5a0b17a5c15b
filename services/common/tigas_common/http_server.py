"""uvicorn's HTTP/1.1 server with limits on connections, in total and per address, and on slow requests."""

from __future__ import annotations

import asyncio
import errno
import math
import socket
import ssl
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus

import h11
import uvicorn
from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from tigas_common.address import client_network
from tigas_common.errors import InvalidRequest, RequestTimeout, TigasError, TooManyConnections, problem
from tigas_common.limits import HttpLimits, IdleTimeout
from tigas_common.web import ARRIVAL_KEY

BATCH = 32
"""Connections accepted before other tasks get a turn."""
RESOURCE_ERRORS = {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}
RESOURCE_PAUSE_S = 0.5
"""Seconds to wait before accepting another connection after the system ran out of resources."""


def tcp_congestion_control() -> str | None:
    """The kernel's congestion control for new TCP connections, such as `cubic`; None if unknown (not Linux)."""
    if not hasattr(socket, "TCP_CONGESTION"):
        return None
    with socket.socket() as probe:
        return probe.getsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, 16).rstrip(b"\0").decode()


class Server(uvicorn.Server):
    """A server that leaves signals to its caller, so that several can share a process, and reports its start."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.started_event = asyncio.Event()

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class LimitedServer(Server):
    """Serves one listening socket and accepts its connections itself, so that TLS handshakes count as well."""

    def __init__(self, config: uvicorn.Config, limits: HttpLimits, tls: ssl.SSLContext | None) -> None:
        super().__init__(config)
        self._limits = limits
        self._tls = tls
        self._opening: dict[asyncio.Task[None], str] = {}
        """Client addresses of connections being opened; uvicorn knows the open ones."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        assert sockets is not None
        [listener] = sockets
        listener.setblocking(False)
        self.servers = []
        self._accepting = asyncio.create_task(self._accept(listener))
        self.started = True
        self.started_event.set()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        for task in (self._accepting, *self._opening):
            task.cancel()
        await asyncio.gather(self._accepting, *self._opening, return_exceptions=True)
        await super().shutdown(sockets)

    async def _accept(self, listener: socket.socket) -> None:
        """Accept or refuse connections in batches, so that refused ones do not delay others."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, peer = await loop.sock_accept(listener)
                clients = self._count()
                self._take(connection, client_network(peer[0]), clients)
                for _ in range(BATCH - 1):
                    connection, peer = listener.accept()
                    self._take(connection, client_network(peer[0]), clients)
            except BlockingIOError:
                pass
            except OSError as error:  # any other error means that the client has left
                await asyncio.sleep(RESOURCE_PAUSE_S if error.errno in RESOURCE_ERRORS else 0)
            await asyncio.sleep(0)  # accepting may not block, so give other tasks a turn

    def _count(self) -> Counter[str]:
        clients = Counter(self._opening.values())
        for protocol in self.server_state.connections:
            if (peer := getattr(protocol, "client", None)) is not None:
                clients[client_network(peer[0])] += 1
        return clients

    def _take(self, connection: socket.socket, client: str, clients: Counter[str]) -> None:
        connection.setblocking(False)
        try:
            self._check(client, clients)
        except TooManyConnections as error:
            self._refuse(connection, error)
        else:
            clients[client] += 1
            task = asyncio.create_task(self._open(connection))
            self._opening[task] = client
            task.add_done_callback(self._opened)

    def _check(self, client: str, clients: Counter[str]) -> None:
        if clients[client] >= self._limits.connections_per_address:
            raise TooManyConnections(
                f"Your address has {clients[client]} connections, the maximum; close some, or try later."
            )
        if clients.total() >= self._limits.connections:
            raise TooManyConnections(f"There are {clients.total()} connections, the maximum; try later.")

    def _refuse(self, connection: socket.socket, error: TooManyConnections) -> None:
        with connection, suppress(OSError):
            if self._tls is None:
                connection.send(final_response(error))

    async def _open(self, connection: socket.socket) -> None:
        task = asyncio.current_task()
        assert task is not None
        handshake_s = self._limits.header_s if self._tls else None
        with suppress(OSError):  # the client has left, or does not speak TLS
            await asyncio.get_running_loop().connect_accepted_socket(
                lambda: LimitedProtocol(self.config, self.server_state, self._limits, lambda: self._opened(task)),
                connection,
                ssl=self._tls,
                ssl_handshake_timeout=handshake_s,
                ssl_shutdown_timeout=handshake_s,
            )

    def _opened(self, task: asyncio.Task[None]) -> None:
        self._opening.pop(task, None)


class LimitedProtocol(H11Protocol):
    """One connection. uvicorn limits how long it is idle; this class limits how long a request takes to arrive."""

    def __init__(
        self, config: uvicorn.Config, server_state: ServerState, limits: HttpLimits, opened: Callable[[], None]
    ) -> None:
        """opened: called once uvicorn counts the connection."""
        super().__init__(config, server_state, app_state={})
        self.timeout_keep_alive = limits.idle_s
        self._limits = limits
        self._opened = opened
        self._has_data = False
        """Whether any data has been received."""
        self._watched_state: object = None
        """The client state to which `_timeout` applies."""
        self._timeout: IdleTimeout | None = None
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.flow = _Flow(transport, self._restart_timeout)
        self._opened()
        self._update_timeout()

    def data_received(self, data: bytes) -> None:
        self._has_data = True
        self.app_state[ARRIVAL_KEY] = time.monotonic()  # copied to a request's scope when its headers are complete
        super().data_received(data)
        self._update_timeout(len(data))

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._update_timeout()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        if self._timer is not None:
            self._timer.cancel()

    def _update_timeout(self, received: int = 0) -> None:
        """Start, continue or stop the timeout, depending on the data expected from the client."""
        now, state = self.loop.time(), self.conn.their_state
        if self.transport.get_protocol() is not self:  # it is a WebSocket now
            state = h11.SWITCHED_PROTOCOL
        if state is self._watched_state and self._timeout is not None:
            self._timeout.extend(received, now)
            return
        self._watched_state = state
        if state is h11.SEND_BODY:
            self._begin(self._limits.body_s, self._limits.body_bytes_per_s)
        elif state is h11.IDLE and self.timeout_keep_alive_task is None:
            self._begin(self._limits.header_s, math.inf)  # received data does not extend it
        else:
            self._timeout = None

    def _begin(self, seconds: float, bytes_per_s: float) -> None:
        self._timeout = IdleTimeout(seconds, bytes_per_s, self.loop.time())
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_at(self._timeout.expires_at, self._expired)

    def _restart_timeout(self) -> None:
        """Restart the timeout, as the delay so far was the application's and not the client's."""
        if self._timeout is not None:
            self._begin(self._timeout.seconds, self._timeout.bytes_per_s)

    def _expired(self) -> None:
        if self._timeout is None or self.flow.read_paused or self.transport.is_closing():
            return
        if self.loop.time() < self._timeout.expires_at:
            self._timer = self.loop.call_at(self._timeout.expires_at, self._expired)
        else:
            what = "body" if self._watched_state is h11.SEND_BODY else "headers"
            self._abort(RequestTimeout(f"The request's {what} did not arrive in time."))

    def send_400_response(self, msg: str) -> None:
        """Close the connection; uvicorn would answer even after the application has, and let it answer again."""
        self._abort(InvalidRequest("The request is not valid HTTP/1.1."))

    def _abort(self, error: TigasError) -> None:
        if self.cycle is not None and not self.cycle.response_complete:  # further data is dropped
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if self._has_data and self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            self.transport.write(final_response(error))
        self.transport.close()


class _Flow(FlowControl):
    """uvicorn's flow control, which reports when it resumes reading."""

    def __init__(self, transport: asyncio.Transport, resumed: Callable[[], None]) -> None:
        super().__init__(transport)
        self._resumed = resumed

    def resume_reading(self) -> None:
        if self.read_paused:
            super().resume_reading()
            self._resumed()


def final_response(error: TigasError) -> bytes:
    """An error as the bytes of an HTTP/1.1 response that closes the connection."""
    answer = problem(error)
    body = answer.model_dump_json().encode()
    lines = (
        f"HTTP/1.1 {answer.status} {HTTPStatus(answer.status).phrase}",
        "Content-Type: application/problem+json",
        f"Content-Length: {len(body)}",
        "Cache-Control: no-store",
        "Connection: close",
    )
    return "\r\n".join((*lines, "", "")).encode() + body
