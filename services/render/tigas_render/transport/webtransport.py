"""WebTransport over HTTP/3: a session and its streams."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Sequence
from typing import Protocol

from aioquic.h3.connection import ErrorCode

from tigas_common.errors import BodyTooLarge, InvalidRequest, Overloaded, TigasError
from tigas_common.parsing import MAX_BODY
from tigas_render.frame import Client, Withdraw
from tigas_render.transport.outlet import DatagramOutlet, Outlet

DRAFT_HEADER = (b"sec-webtransport-http3-draft", b"draft02")
"""The draft that browsers speak and expect in the answer."""
CANCELLED = 0x52E4A40FA8DB
"""WebTransport's application error 0 as an HTTP/3 error code."""

Parts = Sequence[bytes | memoryview]
"""Bytes, one part after the other."""
Answer = Callable[[Parts], None]
"""Sends bytes and ends the stream. The parts are not needed any more when it returns."""

_numbers = itertools.count(1)


class SessionHandler(Protocol):
    """Answers one session's client. None of this may wait."""

    def check(self) -> None:
        """Raises a TigasError if the client may not ask for anything now."""

    def request(self, body: bytes, arrived: float, answer: Answer) -> Withdraw:
        """Answer a request received on a bidirectional stream at a time of the monotonic clock.

        `answer` is called once, unless the request is cancelled before, with the function returned here.
        """

    def failure(self, error: Exception, body: bytes) -> Parts:
        """The answer to an otherwise unanswerable request; `body` is the error."""

    def datagram(self, data: bytes, arrived: float) -> None:
        """Take a datagram that arrived at a time of the monotonic clock."""

    def stopped(self) -> None:
        """The client does not get the complete answer: it has stopped reading, or is too slow."""

    def closed(self) -> None:
        """The session is over, and its streams are cancelled."""


SessionFactory = Callable[[Client, DatagramOutlet], SessionHandler]
"""Makes the handler of a new session, from its client, which no other session has, and its datagrams."""


class WebTransportSession:
    """One session, on the stream that opened it."""

    def __init__(self, outlet: Outlet, datagrams: DatagramOutlet, address: str, make_handler: SessionFactory) -> None:
        """address: the client's."""
        self.handler = make_handler(Client(address, f"session {next(_numbers)}", "webtransport"), datagrams)
        self._outlet = outlet
        self._datagrams = datagrams

    def close(self) -> None:
        """End the session and its own stream."""
        self.handler.closed()
        self._datagrams.close()
        self._outlet.end()
        self._outlet.abort(ErrorCode.H3_NO_ERROR)


class WebTransportStream:
    """One bidirectional stream that the client opened: a request, and its answer."""

    abort_code: int = CANCELLED
    task = None

    def __init__(self, outlet: Outlet, session: WebTransportSession, overload: str | None = None) -> None:
        """overload: why the request is not taken, if it is not."""
        self.outlet = outlet
        self.session = session
        self._overload = overload
        self._body = b""
        self._is_read = False
        self._is_answered = False
        self._withdraw: Withdraw | None = None
        self._timeout: asyncio.TimerHandle | None = None
        self._ended: Callable[[], None] | None = None
        """None before it is started, and once it is over."""

    def start(self, ended: Callable[[], None]) -> None:
        """Handle incoming data from now on; `ended` is called at the end."""
        self._ended = ended
        try:
            if self._overload is not None:
                raise Overloaded(self._overload)
            self.session.handler.check()  # without a look at the request
        except TigasError as error:
            self._fail(error)

    def data_received(self, data: bytes, ended: bool, arrived: float) -> None:
        """Handle a part of the client's data; `ended` with the last."""
        if self._is_read:
            return
        self._body += data
        if len(self._body) > MAX_BODY:
            self._fail(BodyTooLarge(f"The body has more than {MAX_BODY} bytes."))
        elif ended:
            self._read()
            withdraw = self.session.handler.request(self._body, arrived, self._answer)
            if self._ended is not None:
                self._withdraw = withdraw
        elif self._timeout is None:
            loop = asyncio.get_running_loop()
            late = InvalidRequest("The request was not finished in time.")
            self._timeout = loop.call_later(self.outlet.limits.request_timeout, self._fail, late)

    def cancelled(self) -> None:
        """The client has cancelled or disconnected."""
        self._read()
        if self._withdraw is not None:
            self._withdraw()
        elif self._is_answered:
            self.session.handler.stopped()
        self._end()

    def _read(self) -> None:
        """Nothing more is read."""
        self._is_read = True
        if self._timeout is not None:
            self._timeout.cancel()

    def _fail(self, error: TigasError) -> None:
        self._read()
        self._answer(self.session.handler.failure(error, self._body))

    def _answer(self, parts: Parts) -> None:
        self._withdraw, self._is_answered = None, True
        self.outlet.finish(parts, self._end)

    def _end(self) -> None:
        ended, self._ended = self._ended, None
        if ended is not None:
            if self._is_answered and self.outlet.is_open:  # not all of it was handed over
                self.session.handler.stopped()
            ended()
