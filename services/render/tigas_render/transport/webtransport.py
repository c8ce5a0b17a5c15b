"""A stream of a WebTransport session: one request, and its answer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from tigas_common.errors import BodyTooLarge, InvalidRequest, Overloaded, TigasError
from tigas_common.parsing import MAX_BODY
from tigas_render.frame import Withdraw
from tigas_render.transport.frames import Parts, RenderSession
from tigas_render.transport.outlet import Outlet

DRAFT_HEADER = (b"sec-webtransport-http3-draft", b"draft02")
"""The draft that browsers speak and expect in the answer."""
CANCELLED = 0x52E4A40FA8DB
"""WebTransport's application error 0 as an HTTP/3 error code."""


class WebTransportStream:
    """A bidirectional stream that the client opened."""

    abort_code: int = CANCELLED
    task = None

    def __init__(self, outlet: Outlet, session: RenderSession, overload: str | None = None) -> None:
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
            self.session.check()  # without a look at the request
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
            withdraw = self.session.request(self._body, arrived, self._answer)
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
            self.session.stopped()
        self._end()

    def _read(self) -> None:
        """Nothing more is read."""
        self._is_read = True
        if self._timeout is not None:
            self._timeout.cancel()

    def _fail(self, error: TigasError) -> None:
        self._read()
        self._answer(self.session.failure(error, self._body))

    def _answer(self, parts: Parts) -> None:
        self._withdraw, self._is_answered = None, True
        self.outlet.finish(parts, self._end)

    def _end(self) -> None:
        ended, self._ended = self._ended, None
        if ended is not None:
            if self._is_answered and self.outlet.is_open:  # not all of it was handed over
                self.session.stopped()
            ended()
