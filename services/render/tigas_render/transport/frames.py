"""The render session of docs/protocol.md: a RenderRequest in, a FrameHeader and an image out."""

from __future__ import annotations

import json
import logging
import math
import struct
import time
from collections.abc import Callable, Sequence
from functools import partial

from tigas_common.errors import InvalidRequest, Overloaded, TigasError, problem
from tigas_common.parsing import parse
from tigas_common.wire.render import FrameHeader, RenderRequest
from tigas_render.admission.load import Load
from tigas_render.admission.viewers import RequestRate
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.transport.datagrams import Datagrams

logger = logging.getLogger(__name__)

MAX_DATAGRAM_REQUESTS = 16
"""Requests by datagram that one session may have running."""


Parts = Sequence[bytes | memoryview]
"""Bytes, one part after the other."""
Answer = Callable[[Parts], None]
"""Sends bytes and ends the stream. The parts are not needed any more when it returns."""


class RenderSession:
    """One viewer. No method may wait."""

    def __init__(self, source: FrameSource, rate: RequestRate, client: Client, datagrams: Datagrams) -> None:
        """client: unique to the session."""
        self._source = source
        self._rate = rate
        self._client = client
        self._datagrams = datagrams
        self._running: dict[int, Withdraw] = {}
        """Cancel functions of requests received by datagram, by number."""
        self._has_video = False

    def closed(self) -> None:
        """The session has ended, its streams are cancelled, and so are its requests by datagram."""
        self.stopped()
        for withdraw in self._running.values():
            withdraw()
        self._running.clear()
        self._datagrams.close()

    def stopped(self) -> None:
        """The client does not get all of an answer: it has stopped reading, or is too slow."""
        if self._has_video:
            self._has_video = False
            self._source.forget(self._client)

    # -- streams -----------------------------------------------------------------------------------------------------

    def check(self) -> None:
        """Raises a TigasError if the client asks more often than it may."""
        self._rate.check(self._client)

    def request(self, body: bytes, arrived: float, answer: Answer) -> Withdraw:
        """Answer a request received on a stream at a time of the monotonic clock.

        `answer` is called once, unless the request is cancelled before, with the function returned here.
        """

        def answered(result: Frame | Exception) -> None:
            if isinstance(result, Frame):
                answer((_header(result, self._rate.told), result.body))
                result.release()
            else:
                answer(self.failure(result, body))

        return self._ask(body, arrived, answered, is_ordered=True)

    def failure(self, error: Exception, body: bytes) -> Parts:
        """The answer to a failed request; `body` is the error."""
        return (_failure(error, body, self._rate.told),)

    # -- datagrams ---------------------------------------------------------------------------------------------------

    def datagram(self, body: bytes, arrived: float) -> None:
        """Answer a request in a datagram that arrived at a time of the monotonic clock."""
        if not self._datagrams.can_send:
            return
        number = self._datagrams.next_request()
        try:
            if len(self._running) >= MAX_DATAGRAM_REQUESTS:
                raise Overloaded(f"This session has {MAX_DATAGRAM_REQUESTS} requests running.")
            self._rate.check(self._client)
        except TigasError as error:
            self._send_problem(error, body)
            return
        self._running[number] = _nothing
        withdraw = self._ask(body, arrived, partial(self._answered_datagram, number, body))
        if number in self._running:
            self._running[number] = withdraw

    def _answered_datagram(self, number: int, body: bytes, result: Frame | Exception) -> None:
        del self._running[number]
        if isinstance(result, Frame):
            answer = b"".join((_header(result, self._rate.told), result.body))
            result.release()
            try:
                self._datagrams.send_frame(number, result.seq, answer)
            except InvalidRequest as error:
                self._send_problem(error, body)
        else:
            self._send_problem(result, body)

    def _send_problem(self, error: Exception, body: bytes) -> None:
        self._datagrams.send_problem(_seq(body), _failure(error, body, self._rate.told))

    def _ask(self, body: bytes, arrived: float, answered: Answered, *, is_ordered: bool = False) -> Withdraw:
        """is_ordered: whether no part of the answer gets lost."""
        try:
            request = parse(RenderRequest, body)
            if not is_ordered:
                self._datagrams.check(request)
            if request.video is not None:
                self._has_video = True
            return self._source.request(self._client, request, arrived, answered)
        except Exception as error:
            answered(error)
            return _nothing


SessionFactory = Callable[[Client, Datagrams], RenderSession]
"""Makes a new session, from its client, which no other session has, and its datagrams."""


def render_session(source: FrameSource, rate: RequestRate | None = None) -> SessionFactory:
    """Factory of the `/render` sessions. rate: request rate of each; None: unlimited."""
    rates = RequestRate(Load(), math.inf, time.monotonic) if rate is None else rate
    return lambda client, datagrams: RenderSession(source, rates, client, datagrams)


def _nothing() -> None:
    """Withdraws a request that was answered already."""


def _header(frame: Frame, requests_per_s: float | None) -> bytes:
    """Header that precedes a frame's body."""
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
            video=frame.video,
            timing=frame.timing,
            requests_per_s=requests_per_s,
        )
    )


def _failure(error: Exception, body: bytes, requests_per_s: float | None) -> bytes:
    if not isinstance(error, TigasError):
        logger.error("A render request failed", exc_info=error)
    about = problem(error)
    header = FrameHeader(
        status=about.status,
        seq=_seq(body),
        content_type="application/problem+json",
        requests_per_s=requests_per_s,
    )
    return _encode(header) + about.model_dump_json().encode()


def _encode(header: FrameHeader) -> bytes:
    text = header.model_dump_json().encode()
    return struct.pack("!I", len(text)) + text


def _seq(body: bytes) -> int:
    """The number of an unreadable request, if it can be determined; 0 otherwise."""
    try:
        seq = json.loads(body)["seq"]
    except (ValueError, TypeError, KeyError, RecursionError):
        return 0
    return seq if type(seq) is int and 0 <= seq < 2**32 else 0
