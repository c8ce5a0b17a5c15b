"""The render session of docs/protocol.md: a RenderRequest in, a FrameHeader and an image out."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import struct
import time

from tigas_common.errors import Overloaded, TigasError, problem
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire.render import FrameHeader, RenderRequest
from tigas_render.frame import Client, Frame, FrameSource
from tigas_render.transport.datagrams import DatagramSender
from tigas_render.transport.load import Load
from tigas_render.transport.outlet import DatagramOutlet
from tigas_render.transport.request_rate import RequestRate
from tigas_render.transport.webtransport import SessionFactory, WebTransportStream

logger = logging.getLogger(__name__)

MAX_DATAGRAM_REQUESTS = 16
"""Requests by datagram that one session may have running."""


def render_session(source: FrameSource, rate: RequestRate | None = None) -> SessionFactory:
    """What answers the `/render` sessions. rate: how often each may ask; None: as often as it likes."""
    rates = RequestRate(Load(), math.inf, time.monotonic) if rate is None else rate
    return lambda client, datagrams: RenderSession(source, rates, client, datagrams)


class RenderSession:
    """One viewer."""

    def __init__(self, source: FrameSource, rate: RequestRate, client: Client, datagrams: DatagramOutlet) -> None:
        """client: one that no other session has."""
        self._source = source
        self._rate = rate
        self._client = client
        self._sender = DatagramSender(datagrams)
        self._tasks: set[asyncio.Task[None]] = set()

    def closed(self) -> None:
        """The session is over: what was asked for by datagram is no longer wanted."""
        for task in self._tasks:
            task.cancel()

    # -- streams -----------------------------------------------------------------------------------------------------

    async def stream(self, stream: WebTransportStream) -> None:
        """Answer the request on a stream."""
        body = b""
        try:
            self._rate.check(self._client)  # without a look at the request
            body = await stream.read(MAX_BODY)
            answer = _success(await self._frame(body, stream.arrived), self._rate.told)
        except Exception as error:
            answer = _failure(error, body, self._rate.told)
        await stream.outlet.finish(answer)

    # -- datagrams ---------------------------------------------------------------------------------------------------

    def datagram(self, body: bytes, arrived: float) -> None:
        """Answer the request in a datagram."""
        if not self._sender.can_send:
            return
        number = self._sender.next_request()
        if len(self._tasks) >= MAX_DATAGRAM_REQUESTS:
            error: TigasError = Overloaded(f"This session has {MAX_DATAGRAM_REQUESTS} requests running.")
        elif not self._rate.allows(self._client):
            error = self._rate.error
        else:
            task = asyncio.create_task(self._answer_datagram(number, body, arrived))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
            return
        self._sender.send_problem(_seq(body), _failure(error, body, self._rate.told))

    async def _answer_datagram(self, number: int, body: bytes, arrived: float) -> None:
        try:
            frame = await self._frame(body, arrived)
        except Exception as error:
            self._sender.send_problem(_seq(body), _failure(error, body, self._rate.told))
        else:
            self._sender.send_frame(number, frame.seq, _success(frame, self._rate.told))

    async def _frame(self, body: bytes, arrived: float) -> Frame:
        return await self._source.submit(self._client, parse(RenderRequest, body), arrived)


def _success(frame: Frame, requests_per_s: float | None) -> bytes:
    header = FrameHeader(
        status=200,
        seq=frame.seq,
        content_type=frame.content_type,
        width=frame.width,
        height=frame.height,
        margin_x=frame.margin_x or None,
        margin_y=frame.margin_y or None,
        profile=frame.profile,
        timing=frame.timing,
        requests_per_s=requests_per_s,
    )
    answer = _answer(header, frame.body)
    frame.release()
    return answer


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
    return _answer(header, about.model_dump_json().encode())


def _answer(header: FrameHeader, body: bytes | memoryview) -> bytes:
    text = header.model_dump_json().encode()
    return b"".join((struct.pack("!I", len(text)), text, body))


def _seq(body: bytes) -> int:
    """The number of a request that could not be read, as far as it can be told; 0 otherwise."""
    try:
        seq = json.loads(body)["seq"]
    except (ValueError, TypeError, KeyError, RecursionError):
        return 0
    return seq if type(seq) is int and 0 <= seq < 2**32 else 0
