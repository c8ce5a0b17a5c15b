"""An edge's end of its pipe, which answers requests with the engine's frames and reconnects to a restarted engine."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final, Self

from tigas_common.errors import Overloaded, TigasError
from tigas_common.wire.render import RenderRequest
from tigas_render.admission.load import LoadState
from tigas_render.frame import Cancel, Client, Frame, FrameSource, OnAnswer
from tigas_render.pipe.arena import FD_MESSAGE, map_arena
from tigas_render.pipe.link import Kind, Link, encode_message
from tigas_render.pipe.messages import pack_request, unpack_frame

logger = logging.getLogger(__name__)

RETRY_AFTER_S: Final = 1.0
RECONNECT_S: Final = 0.1

OnState = Callable[[float, float], None]
"""Called with the age of the engine's queue in seconds, and its utilisation, 0 to 1."""


class EngineUnavailable(Overloaded):
    """The engine is not available, or is down."""

    def __init__(self) -> None:
        super().__init__("The renderer is restarting; try again soon.", RETRY_AFTER_S)


class PipeClient(FrameSource):
    """Frames of the engine behind a Unix socket; an async context manager that keeps the pipe open.

    While the engine is down, requests are answered with Overloaded and a retry time.
    """

    def __init__(self, path: Path, edge: int, on_state: OnState) -> None:
        """edge: this process's number."""
        self._path = path
        self._edge = edge
        self._on_state = on_state
        self._link: EngineLink | None = None
        self.connections = 0
        """Number of connections so far. A new connection means a new engine, without loaded scenes."""
        self.connected_at = 0.0
        """Time of the last connection, on the monotonic clock."""

    async def __aenter__(self) -> Self:
        self._connection_task = asyncio.create_task(self._stay_connected())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._connection_task.cancel()
        await asyncio.gather(self._connection_task, return_exceptions=True)

    @property
    def is_connected(self) -> bool:
        """Whether the engine is connected now."""
        return self._link is not None and not self._link.closed.done()

    @property
    def closed(self) -> asyncio.Future[None]:
        """Done once the connected engine is down. Available only after a connection."""
        assert self._link is not None
        return self._link.closed

    def disconnect(self, reason: str) -> None:
        """Drop the connected engine. Pending requests are answered with an error, and a new connection is made."""
        if self._link is not None:
            self._link.abort(reason)

    def request(self, client: Client, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        if self._link is None or self._link.closed.done():
            return answer_unavailable(on_answer)
        return self._link.request(client, request, arrived, on_answer)

    def forget(self, client: Client) -> None:
        if self._link is not None:
            self._link.forget(client)

    def send_stats(self, state: LoadState) -> None:
        """Send this edge's measurements to the engine. They are dropped while it is down."""
        if self._link is not None:
            self._link.send(encode_message(Kind.STATS, self._edge, state))

    async def _stay_connected(self) -> None:
        while True:
            try:
                link = await self._connect()
            except (OSError, ValueError) as error:
                logger.debug("The engine cannot be reached: %s", error)
            else:
                self._link = link
                self.connections, self.connected_at = self.connections + 1, time.monotonic()
                try:
                    await link.closed
                    logger.warning("The pipe to the engine was closed: %s", link.reason or "the engine is down.")
                finally:
                    self._link = None
                    link.abort("The edge is stopping.")
            await asyncio.sleep(RECONNECT_S)

    async def _connect(self) -> EngineLink:
        loop = asyncio.get_running_loop()
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            sock.setblocking(False)
            await loop.sock_connect(sock, str(self._path))
            arena = await _receive_arena(sock)
            _, link = await loop.create_unix_connection(lambda: EngineLink(arena, self._on_state), sock=sock)
        except BaseException:
            sock.close()
            raise
        return link


class EngineLink(Link):
    """An open pipe to the engine."""

    def __init__(self, arena: memoryview, on_state: OnState) -> None:
        super().__init__()
        self._arena = arena
        self._on_state = on_state
        self._waiting: dict[int, OnAnswer] = {}
        """Pending requests by the edge's request number."""
        self._next = 0
        self.closed: asyncio.Future[None] = self._loop.create_future()
        """Done once the pipe is closed."""

    def connection_lost(self, exc: Exception | None) -> None:
        if not self.closed.done():
            self.closed.set_result(None)
        self._arena = memoryview(b"")  # the memory is released with the last frame in it
        waiting, self._waiting = self._waiting, {}
        for on_answer in waiting.values():
            _deliver(on_answer, EngineUnavailable())

    def request(self, client: Client, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        id = self._next
        self._next = id + 1
        self.send(pack_request(id, client, arrived, time.monotonic(), request))
        self._waiting[id] = on_answer
        return partial(self._cancel, id, tuple(client) if request.video is not None else None)

    def forget(self, client: Client) -> None:
        self.send(encode_message(Kind.FORGET, tuple(client)))

    def handle_message(self, kind: int, values: tuple[Any, ...]) -> None:
        match kind:
            case Kind.FRAME:
                self._frame(*values)
            case Kind.FAILURE:
                self._failure(*values)
            case Kind.STATE:
                self._on_state(*values)
            case _:
                raise AssertionError(f"An engine sends no message of kind {kind}.")

    def _frame(self, id: int, offset: int, length: int, *values: Any) -> None:
        frame = unpack_frame(self._arena[offset : offset + length], values, partial(self._release, offset))
        if (on_answer := self._waiting.pop(id, None)) is None:  # withdrawn while the frame was on its way
            frame.release()
        else:
            _deliver(on_answer, frame)

    def _failure(self, id: int, kind: type[TigasError], detail: str, retry_after_s: float | None) -> None:
        if (on_answer := self._waiting.pop(id, None)) is not None:
            _deliver(on_answer, kind(detail, retry_after_s))

    def _release(self, offset: int) -> None:
        self.send_lazily(encode_message(Kind.RELEASE, offset))

    def _cancel(self, id: int, video_of: tuple[str, ...] | None) -> None:
        """video_of: the client, if the frame belongs to a video."""
        if self._waiting.pop(id, None) is not None:
            self.send(encode_message(Kind.CANCEL, id, video_of))


def _deliver(on_answer: OnAnswer, answer: Frame | Exception) -> None:
    try:
        on_answer(answer)
    except Exception:  # all viewers share the pipe
        logger.exception("An answer was not delivered")


def answer_unavailable(on_answer: OnAnswer) -> Cancel:
    """Answer a request with an error because it cannot reach an engine."""
    return asyncio.get_running_loop().call_soon(on_answer, EngineUnavailable()).cancel


async def _receive_arena(sock: socket.socket) -> memoryview:
    """Receive the arena, which is the first thing that the engine sends. Raises ValueError and OSError."""
    loop = asyncio.get_running_loop()
    readable = loop.create_future()
    loop.add_reader(sock, lambda: None if readable.done() else readable.set_result(None))
    try:
        await readable
    finally:
        loop.remove_reader(sock)
    _, fds, _, _ = socket.recv_fds(sock, len(FD_MESSAGE), 1)
    if not fds:
        raise ConnectionError("The engine did not send an arena.")
    return map_arena(fds[0])
