"""An edge's end of its pipe: it answers requests with the engine's frames, and reconnects to a restarted engine."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final, Self

from tigas_common.errors import Overloaded
from tigas_common.wire.render import RenderRequest
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.pipe import messages
from tigas_render.pipe.arena import map_arena
from tigas_render.pipe.link import PREFIX, BadMessage, Kind, Link, framed

logger = logging.getLogger(__name__)

MOST_FRAME_BYTES: Final = 128 * 1024 * 1024
"""In a message with a frame; the largest is a PNG of noise, of 3 bytes for each of MAX_PIXELS."""
KNOWN_SESSIONS: Final = 4096
"""Maximum number of introduced sessions: the least recently used one is introduced again on its next request."""
RETRY_AFTER_S: Final = 1.0
CONNECT_AGAIN_S: Final = 0.1

OnState = Callable[[float, float], None]
"""Called with the age of the engine's queue, in seconds, and its utilisation, 0 to 1."""


class EngineGone(Overloaded):
    """There is no engine, or no more."""

    def __init__(self) -> None:
        super().__init__("The renderer is restarting; try again soon.", RETRY_AFTER_S)


class PipeClient(FrameSource):
    """The frames of the engine behind a Unix socket; an async context manager that keeps the pipe open.

    While the engine is down, requests are answered with Overloaded and a retry time.
    """

    def __init__(self, path: Path, edge: int, on_state: OnState) -> None:
        """edge: this process's number."""
        self._path = path
        self._edge = edge
        self._on_state = on_state
        self._link: EngineLink | None = None
        self.connections = 0
        """Number of connections made: a new engine has no loaded scenes."""
        self.connected_at = 0.0
        """When it was the last time, on the monotonic clock."""

    async def __aenter__(self) -> Self:
        self._keeping = asyncio.create_task(self._keep())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._keeping.cancel()
        await asyncio.gather(self._keeping, return_exceptions=True)

    @property
    def is_connected(self) -> bool:
        """Whether there is an engine now."""
        return self._link is not None and not self._link.lost.done()

    @property
    def lost(self) -> asyncio.Future[None]:
        """Done once the connected engine is down; requires a connection."""
        assert self._link is not None
        return self._link.lost

    def give_up(self, reason: str) -> None:
        """Drop the connected engine: pending requests are answered, and a new connection is made."""
        if self._link is not None:
            self._link.abort(reason)

    def request(self, client: Client, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        if self._link is None or self._link.lost.done():
            return no_engine(answered)
        return self._link.request(client, request, arrived, answered)

    def forget(self, client: Client) -> None:
        if self._link is not None:
            self._link.forget(client)

    def tell(self, stats: bytes) -> None:
        """Send this edge's measurements to the engine, as JSON; lost while it is down."""
        if self._link is not None:
            self._link.send(framed(Kind.STATS, stats))

    async def _keep(self) -> None:
        while True:
            try:
                link = await self._connect()
            except (OSError, ValueError, BadMessage) as error:
                logger.debug("The engine cannot be reached: %s", error)
            else:
                self._link = link
                self.connections, self.connected_at = self.connections + 1, time.monotonic()
                try:
                    await link.lost
                    logger.warning("The pipe to the engine was closed: %s", link.reason or "the engine is down.")
                finally:
                    self._link = None
                    link.abort("The edge is stopping.")
            await asyncio.sleep(CONNECT_AGAIN_S)

    async def _connect(self) -> EngineLink:
        loop = asyncio.get_running_loop()
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            sock.setblocking(False)
            await loop.sock_connect(sock, str(self._path))
            arena = await _receive_arena(sock)
            _, link = await loop.create_unix_connection(
                lambda: EngineLink(arena, self._edge, self._on_state), sock=sock
            )
        except BaseException:
            sock.close()
            raise
        return link


class EngineLink(Link):
    """The pipe while it is open."""

    def __init__(self, arena: memoryview, edge: int, on_state: OnState) -> None:
        super().__init__(MOST_FRAME_BYTES)
        self._arena = arena
        self._on_state = on_state
        self._waiting: dict[int, Answered] = {}
        """By this edge's number for the request."""
        self._next = 0
        self._sessions: OrderedDict[Client, int] = OrderedDict()
        """Sessions known to the engine, by their last request."""
        self._introduced = 0
        self.lost: asyncio.Future[None] = self._loop.create_future()
        """Done once the pipe is closed."""
        self._edge = edge

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.send(messages.pack_number(Kind.OPEN, self._edge))

    def connection_lost(self, exc: Exception | None) -> None:
        if not self.lost.done():
            self.lost.set_result(None)
        self._arena = memoryview(b"")  # the last frame in the memory releases it
        waiting, self._waiting = self._waiting, {}
        for answered in waiting.values():
            _call(answered, EngineGone())

    def request(self, client: Client, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        id = self._next
        self._next = (id + 1) % 2**32
        self.send(messages.pack_request(id, self._session(client), arrived, time.monotonic(), request))
        self._waiting[id] = answered
        return partial(self._withdraw, id)

    def forget(self, client: Client) -> None:
        number = self._sessions.pop(client, None)
        if number is not None:
            self.send(messages.pack_number(Kind.BYE, number))

    def received(self, kind: int, content: bytes) -> None:
        match kind:
            case Kind.FRAME | Kind.INLINE:
                self._frame(messages.unpack_frame(content, is_inline=kind == Kind.INLINE), kind)
            case Kind.FAILURE:
                id, error = messages.unpack_failure(content)
                if (answered := self._waiting.pop(id, None)) is not None:
                    _call(answered, error)
            case Kind.STATE:
                self._on_state(*messages.unpack_state(content))
            case _:
                raise BadMessage(f"No message of kind {kind} is expected.")

    def _frame(self, found: messages.FrameMessage, kind: int) -> None:
        answered = self._waiting.pop(found.id, None)
        if kind == Kind.INLINE:
            if answered is not None:
                _call(answered, Frame(found.inline, *found.fields))
            return
        end = found.offset + found.length
        if end > len(self._arena):
            raise BadMessage("A frame lies beyond the end of the arena.")
        if answered is None:  # withdrawn when it was on its way
            self._release(found.offset)
            return
        body = self._arena[found.offset : end]
        _call(answered, Frame(body, *found.fields, partial(self._release, found.offset)))

    def _release(self, offset: int) -> None:
        self.send_with_next(messages.pack_number(Kind.RELEASE, offset))

    def _withdraw(self, id: int) -> None:
        if self._waiting.pop(id, None) is not None:
            self.send(messages.pack_number(Kind.WITHDRAW, id))

    def _session(self, client: Client) -> int:
        """The number under which the engine knows a client."""
        number = self._sessions.get(client)
        if number is not None:
            self._sessions.move_to_end(client)
            return number
        if len(self._sessions) >= KNOWN_SESSIONS:
            _, oldest = self._sessions.popitem(last=False)
            self.send(messages.pack_number(Kind.BYE, oldest))
        self._introduced = number = self._introduced + 1
        self._sessions[client] = number
        self.send(messages.pack_hello(number, client))
        return number


def _call(answered: Answered, answer: Frame | Exception) -> None:
    try:
        answered(answer)
    except Exception:  # the pipe is everybody's
        logger.exception("An answer was not delivered")


def no_engine(answered: Answered) -> Withdraw:
    """Answer a request that cannot reach an engine."""
    return asyncio.get_running_loop().call_soon(answered, EngineGone()).cancel


async def _receive_arena(sock: socket.socket) -> memoryview:
    """The arena that the engine passes first of all. Raises BadMessage, ValueError and OSError."""
    loop = asyncio.get_running_loop()
    readable = loop.create_future()
    loop.add_reader(sock, lambda: None if readable.done() else readable.set_result(None))
    try:
        await readable
    finally:
        loop.remove_reader(sock)
    expected = len(messages.pack_number(Kind.ARENA, 0))
    message, fds, _, _ = socket.recv_fds(sock, expected, 1)
    if len(message) != expected or len(fds) != 1 or PREFIX.unpack_from(message)[1] != Kind.ARENA:
        for fd in fds:
            socket.close(fd)
        raise BadMessage("The engine has passed no arena.")
    return map_arena(fds[0], messages.unpack_number(message[PREFIX.size :]))
