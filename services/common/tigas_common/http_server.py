"""uvicorn's HTTP/1.1 server, with limits on connections: in all, and per address."""

from __future__ import annotations

import asyncio
import errno
import socket
import ssl
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import uvicorn

from tigas_common.errors import TooManyConnections
from tigas_common.http_limits import HttpLimits
from tigas_common.http_protocol import LimitedProtocol, last_answer
from tigas_common.peers import client_network

BATCH = 32
"""Connections accepted before others have their turn."""
EXHAUSTED = {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}
EXHAUSTED_S = 0.5
"""Pause in seconds before the next connection is accepted, after the system ran out of resources to accept one."""


class LimitedServer(uvicorn.Server):
    """Serves one listening socket, and accepts connections itself: a TLS handshake counts as a connection as
    well.

    It leaves signals to its caller, so that several can share a process.
    """

    def __init__(self, config: uvicorn.Config, limits: HttpLimits, tls: ssl.SSLContext | None) -> None:
        super().__init__(config)
        self.started_event = asyncio.Event()
        self._limits = limits
        self._tls = tls
        self._opening: dict[asyncio.Task[None], str] = {}
        """Addresses with connections being opened; uvicorn knows the open ones."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

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
        """Open or refuse connections, several at a time: refused ones must not delay others."""
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
            except OSError as error:  # else the client has left
                await asyncio.sleep(EXHAUSTED_S if error.errno in EXHAUSTED else 0)
            await asyncio.sleep(0)  # accepting may not block, so other tasks get their turns here

    def _count(self) -> Counter[str]:
        """How many connections each client has."""
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
                f"Your address has {clients[client]} connections, and may have no more; close some, or try later."
            )
        if clients.total() >= self._limits.connections:
            raise TooManyConnections(f"There are {clients.total()} connections, and may be no more; try later.")

    def _refuse(self, connection: socket.socket, error: TooManyConnections) -> None:
        with connection, suppress(OSError):
            if self._tls is None:
                connection.send(last_answer(error))

    async def _open(self, connection: socket.socket) -> None:
        task = asyncio.current_task()
        assert task is not None
        patience_s = self._limits.header_s if self._tls else None
        with suppress(OSError):  # the client has left, or does not speak TLS
            await asyncio.get_running_loop().connect_accepted_socket(
                lambda: LimitedProtocol(self.config, self.server_state, self._limits, lambda: self._opened(task)),
                connection,
                ssl=self._tls,
                ssl_handshake_timeout=patience_s,
                ssl_shutdown_timeout=patience_s,
            )

    def _opened(self, task: asyncio.Task[None]) -> None:
        self._opening.pop(task, None)
