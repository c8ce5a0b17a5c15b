"""The engine's end of the pipes, which receives the edges' requests and sends frames through an arena per edge."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

from tigas_common.errors import Overloaded, TigasError
from tigas_render.admission.load import LoadState
from tigas_render.frame import Cancel, Client, Frame, FrameSource
from tigas_render.pipe.arena import FD_MESSAGE, Arena
from tigas_render.pipe.link import Kind, Link, encode_message
from tigas_render.pipe.messages import pack_failure, pack_frame, unpack_request

logger = logging.getLogger(__name__)

ARENA_BYTES: Final = 256 * 1024 * 1024
"""Size of an edge's arena in bytes; pages are allocated on use."""
STATE_INTERVAL_S: Final = 0.1
"""Interval of load reports to edges, in seconds."""
ACCEPT_RETRY_S: Final = 0.1
"""Pause in seconds after a failure to accept an edge, usually because of a lack of file descriptors."""

GetState = Callable[[], tuple[float, float]]
"""Returns the age of the engine's queue in seconds, and its utilisation since the last call, 0 to 1."""
OnStats = Callable[[int, LoadState], None]
"""Receives the number and the measurements of an edge."""


@asynccontextmanager
async def serve_edges(
    path: Path, source: FrameSource, state: GetState, stats: OnStats, *, arena_bytes: int = ARENA_BYTES
) -> AsyncIterator[PipeServer]:
    """Accept edges on a Unix socket, as a context manager.

    The context ends with an exception group if accepting or reporting fails, so that the engine is restarted.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        _bind(listener, path)
        listener.setblocking(False)
        server = PipeServer(source, stats, arena_bytes)
        try:
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(server.accept(listener)), group.create_task(server.broadcast_state(state))]
                try:
                    yield server
                finally:
                    for task in tasks:
                        task.cancel()
        finally:
            server.close()


def _bind(listener: socket.socket, path: Path) -> None:
    path.unlink(missing_ok=True)  # left by an engine that has crashed
    listener.bind(os.fspath(path))
    path.chmod(0o600)
    listener.listen()


class PipeServer:
    """All connected edges."""

    def __init__(self, source: FrameSource, stats: OnStats, arena_bytes: int) -> None:
        self.source = source
        self.stats = stats
        self.edges: set[EdgeLink] = set()
        self._arena_bytes = arena_bytes
        self._accepted = 0
        self.longest_in_pipe_s = 0.0
        """Longest time of a request in the pipe since the last report, in seconds; the event loop may read late."""

    async def accept(self, listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                sock, _ = await loop.sock_accept(listener)
                await self._connect(sock)
            except OSError as error:
                logger.warning("An edge was not connected: %s", error)
                await asyncio.sleep(ACCEPT_RETRY_S)

    async def _connect(self, sock: socket.socket) -> None:
        self._accepted += 1
        with ExitStack() as undo:
            undo.callback(sock.close)
            arena = Arena(self._arena_bytes)
            undo.callback(arena.close)
            # the buffer is empty, so this does not block
            socket.send_fds(sock, [FD_MESSAGE], [arena.fd])
            link = partial(EdgeLink, self, arena, self._accepted)
            await asyncio.get_running_loop().connect_accepted_socket(link, sock)
            undo.pop_all()

    async def broadcast_state(self, state: GetState) -> None:
        """Report the engine's load to all edges, ten times per second, until cancelled."""
        processor, wall = time.thread_time(), time.monotonic()
        while True:
            await asyncio.sleep(STATE_INTERVAL_S)
            age, utilisation = state()
            age, self.longest_in_pipe_s = max(age, self.longest_in_pipe_s), 0.0
            was_processor, was_wall = processor, wall
            processor, wall = time.thread_time(), time.monotonic()
            of_loop = (processor - was_processor) / (wall - was_wall)
            message = encode_message(Kind.STATE, max(0.0, age), min(1.0, max(0.0, utilisation, of_loop)))
            for edge in self.edges:
                edge.send(message)

    def close(self) -> None:
        for edge in list(self.edges):
            edge.abort("The engine is stopping.")


class EdgeLink(Link):
    """The pipe to one edge. When it closes for any reason, the edge's requests are cancelled and its arena is freed."""

    def __init__(self, server: PipeServer, arena: Arena, connection: int) -> None:
        """connection: a unique number."""
        super().__init__()
        self._server = server
        self.arena = arena
        self._connection = connection
        self.running: dict[int, Cancel] = {}
        """Functions that cancel the running requests, by the edge's request number."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._server.edges.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._server.edges.discard(self)
        if self.reason is not None:
            logger.error("An edge was disconnected: %s", self.reason)
        running, self.running = self.running, {}
        for cancel in running.values():
            cancel()
        self.arena.close()

    def handle_message(self, kind: int, values: tuple[Any, ...]) -> None:
        match kind:  # most frequent first
            case Kind.REQUEST:
                self._submit(*values)
            case Kind.RELEASE:
                self.arena.free(*values)
            case Kind.CANCEL:
                self._cancel(*values)
            case Kind.FORGET:
                self._server.source.forget(self._client(*values))
            case Kind.STATS:
                self._server.stats(*values)
            case _:
                raise AssertionError(f"An edge sends no message of kind {kind}.")

    def _client(self, sent: tuple[Any, ...]) -> Client:
        address, session, transport = sent
        # other edges, or an earlier process of this one, may use the same session name
        return Client(address, f"{self._connection} {session}", transport)

    def _submit(self, id: int, sender: tuple[Any, ...], arrived: float, sent: float, values: tuple[Any, ...]) -> None:
        client = self._client(sender)
        self._server.longest_in_pipe_s = max(self._server.longest_in_pipe_s, time.monotonic() - sent)
        self.running[id] = self._server.source.request(
            client, unpack_request(values), arrived, partial(self._on_answer, id, client)
        )

    def _cancel(self, id: int, video_of: tuple[Any, ...] | None) -> None:
        """video_of: the client, if the frame belongs to a video."""
        cancel = self.running.pop(id, None)
        if cancel is not None:
            cancel()
        elif video_of is not None:  # the answer is on its way, and will not be delivered
            self._server.source.forget(self._client(video_of))

    def _on_answer(self, id: int, client: Client, answer: Frame | Exception) -> None:
        del self.running[id]
        if isinstance(answer, Frame):
            self.send(self._pack(id, client, answer))
            answer.release()
            return
        if not isinstance(answer, TigasError):
            logger.error("A render request failed", exc_info=answer)
        self.send(pack_failure(id, answer))

    def _pack(self, id: int, client: Client, frame: Frame) -> bytes:
        offset = self.arena.write(frame.body)
        if offset is None:
            if frame.video is not None:
                self._server.source.forget(client)
            return pack_failure(id, Overloaded("There is no room for the frame; send fewer requests."))
        return pack_frame(id, frame, offset)
