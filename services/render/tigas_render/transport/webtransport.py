"""WebTransport over HTTP/3: a session, its streams and its datagrams."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
from collections import deque
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from aioquic.buffer import encode_uint_var

from tigas_common.errors import BodyTooLarge, InvalidRequest, Overloaded
from tigas_render.transport.stream import CHUNK, Stream, StreamClosed

if TYPE_CHECKING:
    from tigas_render.transport.connection import Connection

logger = logging.getLogger(__name__)

DRAFT_HEADER = (b"sec-webtransport-http3-draft", b"draft02")
"""The draft that browsers speak and expect in the answer."""
CANCELLED = 0x52E4A40FA8DB
"""WebTransport's application error 0 as an HTTP/3 error code."""
MAX_URGENT = 64

SessionHandler = Callable[["WebTransportSession"], Awaitable[None]]
StreamHandler = Callable[["WebTransportStream"], Awaitable[None]]
DatagramHandler = Callable[[bytes], None]

_numbers = itertools.count(1)


class WebTransportSession:
    """One session. Its handler calls `serve`, and is cancelled when the session ends."""

    def __init__(self, connection: Connection, stream_id: int, path: str, handler: SessionHandler) -> None:
        self.path = path
        self.stream_id = stream_id
        self.client = f"{connection.client[0]}#{next(_numbers)}"
        """Names this session among all that the process has had."""
        self.prefix = encode_uint_var(stream_id // 4)
        """What marks a QUIC datagram as one of this session (RFC 9297)."""
        self.outgoing: deque[bytes] = deque()
        """Datagrams that the network has no room for yet. Whoever fills it may empty it again."""
        self.urgent: deque[bytes] = deque(maxlen=MAX_URGENT)
        """Datagrams that go first; when there are too many, the oldest are dropped."""
        self._connection = connection
        self._on_stream: asyncio.Future[StreamHandler] = asyncio.get_running_loop().create_future()
        self._on_datagram: DatagramHandler | None = None
        self._closed = asyncio.Event()
        self.task = asyncio.get_running_loop().create_task(self._run(handler))

    async def serve(self, on_stream: StreamHandler, on_datagram: DatagramHandler | None = None) -> None:
        """Answer the client until it closes the session.

        `on_stream` runs as a task for each bidirectional stream, and is cancelled as soon as the client cancels the
        stream. `on_datagram` is called with each datagram and must not wait.
        """
        self._on_datagram = on_datagram
        self._on_stream.set_result(on_stream)
        await self._closed.wait()

    @property
    def max_datagram(self) -> int:
        """The longest datagram that fits in a packet now, in bytes; may shrink with the path."""
        return self._connection.writer.max_datagram

    def flush(self) -> None:
        """Start sending what was put in `outgoing`."""
        self._connection.transmit_soon()

    def close(self) -> None:
        """End the session, its streams and its handler."""
        if not self._closed.is_set():
            self._closed.set()
            self.outgoing.clear()
            self.urgent.clear()
            self.task.cancel()
            self._connection.router.session_closed(self)

    def datagram_received(self, data: bytes) -> None:
        """Pass a datagram on; one that comes before the handler is ready is dropped, as the network might."""
        if self._on_datagram is not None:
            self._on_datagram(data)

    def capsules_received(self, ended: bool) -> None:
        """The client's half of the session's own stream: it ends with the session; no capsule needs an answer."""
        if ended:
            self.close()

    async def answer(self, stream: WebTransportStream) -> None:
        """Run the stream's handler."""
        handler = await asyncio.shield(self._on_stream)
        await handler(stream)

    async def _run(self, handler: SessionHandler) -> None:
        try:
            await handler(self)
        except Exception:
            logger.exception("The handler of a WebTransport session failed")
        finally:
            self._on_stream.cancel()
            self.close()


class WebTransportStream(Stream):
    """One bidirectional stream that the client opened."""

    abort_code = CANCELLED

    def __init__(
        self, connection: Connection, stream_id: int, session: WebTransportSession, overloaded: bool = False
    ) -> None:
        super().__init__(connection, stream_id)
        self.session = session
        self._overloaded = overloaded
        self._body = bytearray()
        self._ended = False
        self._news = asyncio.Event()

    def data_received(self, data: bytes, ended: bool) -> None:
        self._ended |= ended
        self._body += data
        if len(self._body) > self.connection.service.limits.unread:
            self.connection.writer.abort(self.stream_id, CANCELLED)
            self.cancelled()
        self._news.set()

    def cancelled(self) -> None:
        if self.task is not None:
            self.task.cancel()

    async def read(self, limit: int) -> bytes:
        """All that the client sends, once it has ended its side.

        Raises Overloaded if the connection has too many streams already, BodyTooLarge over `limit` bytes, and
        InvalidRequest if it takes longer than the request timeout.
        """
        if self._overloaded:
            raise Overloaded("This connection has too many requests running.")
        try:
            async with asyncio.timeout(self.connection.service.limits.request_timeout):
                while not self._ended and len(self._body) <= limit:
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            raise InvalidRequest("The request was not finished in time.") from None
        if len(self._body) > limit:
            raise BodyTooLarge(f"The body has more than {limit} bytes.")
        return bytes(self._body)

    async def finish(self, *parts: bytes) -> None:
        """Write and end the stream; waits while the client or the network cannot keep up.

        Raises StreamClosed if the client is gone or has stopped reading.
        """
        first = b"".join(part for part in parts[:-1])
        view = memoryview(parts[-1])
        while True:
            await self.connection.writer.room(self.stream_id)
            size = max(0, CHUNK - len(first))
            chunk, view = first + view[:size], view[size:]
            self.connection.writer.raw(self.stream_id, chunk, end=not view)
            if not view:
                return
            first = b""

    async def run(self) -> None:
        with contextlib.suppress(StreamClosed):
            await self.session.answer(self)
