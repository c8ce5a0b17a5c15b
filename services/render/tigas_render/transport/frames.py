"""The WebTransport session of docs/protocol.md: a RenderRequest in, a FrameHeader and an image out."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import struct
import time
from collections.abc import Callable
from functools import partial

from tigas_common.errors import BodyTooLarge, InvalidRequest, Overloaded, Superseded, TigasError, problem
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire.render import FrameHeader, RenderRequest
from tigas_render.admission.load import Load
from tigas_render.admission.viewers import RequestRate
from tigas_render.frame import Cancel, Client, Frame, FrameSource, OnAnswer
from tigas_render.transport.sending import DatagramSender, LatestFrames, PendingFrame, SendScheduler, StreamWriter

logger = logging.getLogger(__name__)

DRAFT_HEADER = (b"sec-webtransport-http3-draft", b"draft02")
"""The WebTransport draft that browsers use, and expect in the answer."""
CANCELLED = 0x52E4A40FA8DB
"""WebTransport's application error 0, as an HTTP/3 error code."""
MAX_DATAGRAM_REQUESTS = 16
"""Maximum number of a session's running requests that arrived as datagrams."""


class RenderSession:
    """A viewer's WebTransport session. No method blocks."""

    def __init__(
        self, source: FrameSource, rate: RequestRate, client: Client, scheduler: SendScheduler, session_id: int
    ) -> None:
        """client: unique to the session. session_id: the id of the stream that opened the session."""
        self._source = source
        self._rate = rate
        self._client = client
        self._datagrams = DatagramSender(scheduler, session_id)
        self.frames = LatestFrames(scheduler)
        self._running: dict[int, Cancel] = {}
        """Functions that cancel the running requests that arrived as datagrams, by request number."""
        self._has_video = False

    def close(self) -> None:
        """Cancel the requests that arrived as datagrams, when the session has ended and its streams are cancelled."""
        self.handle_missed_answer()
        for cancel in self._running.values():
            cancel()
        self._running.clear()
        self._datagrams.close()
        self.frames.close()

    def handle_missed_answer(self) -> None:
        """Note that the client misses a part of an answer, because it has stopped reading or is too slow."""
        if self._has_video:
            self._has_video = False
            self._source.forget(self._client)

    def check_rate(self) -> None:
        """Count a request. Raises AskedTooOften."""
        self._rate.check(self._client)

    def start_request(self, body: bytes, arrived: float, on_answer: OnAnswer, *, is_ordered: bool = True) -> Cancel:
        """Parse a client's message and call `FrameSource.request`. is_ordered: whether the answer uses a stream."""
        try:
            request = parse(RenderRequest, body)
            if not is_ordered:
                self._datagrams.check(request)
            if request.video is not None:
                self._has_video = True
            return self._source.request(self._client, request, arrived, on_answer)
        except Exception as error:
            on_answer(error)
            return _do_nothing

    def handle_datagram(self, body: bytes, arrived: float) -> None:
        """Answer a request that arrived as a datagram, at `arrived` on the monotonic clock."""
        if not self._datagrams.can_send:
            return
        number = self._datagrams.next_request_number()
        try:
            if len(self._running) >= MAX_DATAGRAM_REQUESTS:
                raise Overloaded(f"This session has {MAX_DATAGRAM_REQUESTS} running requests.")
            self.check_rate()
        except TigasError as error:
            self._send_error(error, body)
            return
        self._running[number] = _do_nothing
        cancel = self.start_request(body, arrived, partial(self._answer_datagram, number, body), is_ordered=False)
        if number in self._running:
            self._running[number] = cancel

    def _answer_datagram(self, number: int, body: bytes, result: Frame | Exception) -> None:
        del self._running[number]
        if isinstance(result, Frame):
            answer = b"".join((self.frame_header(result), result.body))
            result.release()
            try:
                self._datagrams.send_frame(number, result.seq, answer)
            except InvalidRequest as error:
                self._send_error(error, body)
        else:
            self._send_error(result, body)

    def _send_error(self, error: Exception, body: bytes) -> None:
        self._datagrams.send_error(_seq(body), self.error_answer(error, body))

    def frame_header(self, frame: Frame) -> bytes:
        """The header that precedes a frame's body."""
        return _encode(
            FrameHeader(
                status=200,
                seq=frame.seq,
                content_type=frame.content_type,
                width=frame.width,
                height=frame.height,
                margin_x=frame.margin_x or None,
                margin_y=frame.margin_y or None,
                profile=frame.profile,
                coarse=frame.coarse or None,
                video=frame.video,
                timing=frame.timing,
                requests_per_s=self._rate.announced_rate,
            )
        )

    def error_answer(self, error: Exception, body: bytes) -> bytes:
        """The answer to a failed request. body: the message with the request."""
        if not isinstance(error, TigasError):
            logger.error("A render request failed", exc_info=error)
        about = problem(error)
        header = FrameHeader(
            status=about.status,
            seq=_seq(body),
            content_type="application/problem+json",
            requests_per_s=self._rate.announced_rate,
        )
        return _encode(header) + about.model_dump_json().encode()


SessionFactory = Callable[[Client, SendScheduler, int], RenderSession]
"""Creates a session from its unique client, its connection's scheduler, and its id."""


def render_session(source: FrameSource, rate: RequestRate | None = None) -> SessionFactory:
    """Create a factory of `/render` sessions. rate: limits each session's requests; None for no limit."""
    rates = RequestRate(Load(), math.inf, time.monotonic) if rate is None else rate
    return partial(RenderSession, source, rates)


class WebTransportStream:
    """A bidirectional stream that the client opened, with one request and its answer."""

    abort_code: int = CANCELLED
    task = None

    def __init__(self, writer: StreamWriter, session: RenderSession, overload: str | None = None) -> None:
        """overload: the reason to refuse the request, if any."""
        self.writer = writer
        self.session = session
        self._overload = overload
        self._body = b""
        self._is_read = False
        self._is_answered = False
        self._cancel_request: Cancel | None = None
        self._timeout: asyncio.TimerHandle | None = None
        self._on_end: Callable[[], None] | None = None
        """The callback of `start`; None before the stream has started and after it has ended."""

    def start(self, on_end: Callable[[], None]) -> None:
        """Start handling incoming data. on_end: called when the stream has ended."""
        self._on_end = on_end
        try:
            if self._overload is not None:
                raise Overloaded(self._overload)
            self.session.check_rate()  # before any of the request is read
        except TigasError as error:
            self._answer(error)

    def data_received(self, data: bytes, end_stream: bool, arrived: float) -> None:
        """Handle a part of the client's data. end_stream: whether it is the last part."""
        if self._is_read:
            return
        self._body += data
        if len(self._body) > MAX_BODY:
            self._answer(BodyTooLarge(f"The body has more than {MAX_BODY} bytes."))
        elif end_stream:
            self._stop_reading()
            cancel = self.session.start_request(self._body, arrived, self._answer)
            if self._on_end is not None:
                self._cancel_request = cancel
        elif self._timeout is None:
            loop = asyncio.get_running_loop()
            late = InvalidRequest("The request was not finished in time.")
            self._timeout = loop.call_later(self.writer.limits.request_timeout, self._answer, late)

    def cancel(self) -> None:
        """The client has cancelled or disconnected."""
        self._stop_reading()
        if self._cancel_request is not None:
            self._cancel_request()
        elif self._is_answered:
            self.session.handle_missed_answer()
        self._end()

    def _stop_reading(self) -> None:
        self._is_read = True
        if self._timeout is not None:
            self._timeout.cancel()

    def _answer(self, result: Frame | Exception) -> None:
        self._stop_reading()
        self._cancel_request, self._is_answered = None, True
        if not isinstance(result, Frame):
            self.writer.finish((self.session.error_answer(result, self._body),), self._end)
            return
        if result.video is not None or self.session.frames.can_send:
            self.writer.finish((self.session.frame_header(result), result.body), self._end)
        else:
            send = partial(self.writer.finish, (self.session.frame_header(result), bytes(result.body)), self._end)
            request = parse(RenderRequest, self._body)
            self.session.frames.enqueue(PendingFrame(request, len(result.body), send, self._supersede))
        result.release()

    def _supersede(self) -> None:
        self._answer(Superseded("A newer view is sent instead."))

    def _end(self) -> None:
        on_end, self._on_end = self._on_end, None
        if on_end is not None:
            if self._is_answered and self.writer.is_open:  # the answer was not handed over completely
                self.session.handle_missed_answer()
            on_end()


def _do_nothing() -> None:
    """Do nothing, to cancel a request that has been answered already."""


def _encode(header: FrameHeader) -> bytes:
    text = header.model_dump_json().encode()
    return struct.pack("!I", len(text)) + text


def _seq(body: bytes) -> int:
    """The number of a request that may be invalid; 0 if the number cannot be determined."""
    try:
        seq = json.loads(body)["seq"]
    except (ValueError, TypeError, KeyError, RecursionError):
        return 0
    return seq if type(seq) is int and 0 <= seq < 2**32 else 0
