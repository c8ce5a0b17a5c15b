"""WebTransport over HTTP/3: a session and its streams."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import Callable
from typing import Protocol

from aioquic.h3.connection import ErrorCode

from tigas_common.errors import BodyTooLarge, InvalidRequest, Overloaded
from tigas_render.frame import Client
from tigas_render.transport.outlet import DatagramOutlet, Outlet, StreamClosed

DRAFT_HEADER = (b"sec-webtransport-http3-draft", b"draft02")
"""The draft that browsers speak and expect in the answer."""
CANCELLED = 0x52E4A40FA8DB
"""WebTransport's application error 0 as an HTTP/3 error code."""

_numbers = itertools.count(1)


class SessionHandler(Protocol):
    """Answers one session's client."""

    async def stream(self, stream: WebTransportStream) -> None:
        """Answer a bidirectional stream. Each runs in a task, which is cancelled if the client cancels the stream."""

    def datagram(self, data: bytes, arrived: float) -> None:
        """Take a datagram that arrived at a time of the monotonic clock; must not wait."""

    def closed(self) -> None:
        """The session is over, and its streams are cancelled."""


SessionFactory = Callable[[Client, DatagramOutlet], SessionHandler]
"""Makes the handler of a new session, from its client, which no other session has, and its datagrams."""


class WebTransportSession:
    """One session, on the stream that opened it."""

    def __init__(self, outlet: Outlet, datagrams: DatagramOutlet, address: str, make_handler: SessionFactory) -> None:
        """address: the client's."""
        self.handler = make_handler(Client(address, f"session {next(_numbers)}"), datagrams)
        self._outlet = outlet
        self._datagrams = datagrams

    def close(self) -> None:
        """End the session and its own stream."""
        self.handler.closed()
        self._datagrams.close()
        self._outlet.end()
        self._outlet.abort(ErrorCode.H3_NO_ERROR)


class WebTransportStream:
    """One bidirectional stream that the client opened."""

    abort_code: int = CANCELLED

    def __init__(self, outlet: Outlet, session: WebTransportSession, overload: str | None = None) -> None:
        """overload: why the request is not taken, if it is not."""
        self.outlet = outlet
        self.task: asyncio.Task[None] | None = None
        self.session = session
        self.arrived = 0.0
        """When the newest part of the request arrived, in seconds of the monotonic clock."""
        self._overload = overload
        self._body = bytearray()
        self._ended = False
        self._news = asyncio.Event()

    def data_received(self, data: bytes, ended: bool, arrived: float) -> None:
        """The next part of what the client sends; `ended` with the last."""
        self._ended |= ended
        self.arrived = arrived
        self._body += data
        if len(self._body) > self.outlet.limits.unread:
            self.outlet.abort(CANCELLED)
            self.cancelled()
        self._news.set()

    def cancelled(self) -> None:
        """The client wants no answer any more, or is gone."""
        if self.task is not None:
            self.task.cancel()

    async def run(self) -> None:
        """Let the session's handler answer."""
        with contextlib.suppress(StreamClosed):
            await self.session.handler.stream(self)

    async def read(self, limit: int) -> bytes:
        """All that the client sends, once it has ended its side.

        Raises Overloaded if the client has too many requests running already, BodyTooLarge over `limit` bytes, and
        InvalidRequest if it takes longer than the request timeout.
        """
        if self._overload is not None:
            raise Overloaded(self._overload)
        try:
            async with asyncio.timeout(self.outlet.limits.request_timeout):
                while not self._ended and len(self._body) <= limit:
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            raise InvalidRequest("The request was not finished in time.") from None
        if len(self._body) > limit:
            raise BodyTooLarge(f"The body has more than {limit} bytes.")
        return bytes(self._body)
