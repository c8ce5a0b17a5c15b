"""The render session of docs/protocol.md: a RenderRequest in, a FrameHeader and an image out."""

from __future__ import annotations

import asyncio
import json
import logging
import struct

from tigas_common.errors import Overloaded, TigasError, problem
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire.render import FrameHeader, RenderRequest
from tigas_render.frame import Frame, FrameSource
from tigas_render.transport.datagrams import DatagramSender
from tigas_render.transport.stream import StreamClosed
from tigas_render.transport.webtransport import SessionHandler, WebTransportSession, WebTransportStream

logger = logging.getLogger(__name__)

MAX_DATAGRAM_REQUESTS = 16
"""Requests by datagram that one session may have running."""


def render_session(source: FrameSource) -> SessionHandler:
    """The handler of the `/render` sessions."""

    async def handler(session: WebTransportSession) -> None:
        await RenderSession(source, session).run()

    return handler


class RenderSession:
    """One viewer."""

    def __init__(self, source: FrameSource, session: WebTransportSession) -> None:
        self._source = source
        self._session = session
        self._sender = DatagramSender(session)
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Answer until the session ends."""
        try:
            await self._session.serve(self._stream, self._datagram)
        finally:
            for task in self._tasks:
                task.cancel()

    # -- streams -----------------------------------------------------------------------------------------------------

    async def _stream(self, stream: WebTransportStream) -> None:
        body = b""
        try:
            body = await stream.read(MAX_BODY)
            answer = await self._frame(body)
        except StreamClosed:
            raise
        except Exception as error:
            answer = _failure(error, body)
        await stream.finish(*answer)

    async def _frame(self, body: bytes) -> tuple[bytes, bytes]:
        request = parse(RenderRequest, body)
        return _success(await self._source.submit(self._session.client, request))

    # -- datagrams ---------------------------------------------------------------------------------------------------

    def _datagram(self, body: bytes) -> None:
        if not self._sender.can_send:
            return
        turn = self._sender.next_turn()
        if len(self._tasks) >= MAX_DATAGRAM_REQUESTS:
            error = Overloaded(f"This session has {MAX_DATAGRAM_REQUESTS} requests running.")
            self._sender.send_problem(_seq(body), b"".join(_failure(error, body)))
            return
        task = asyncio.create_task(self._answer_datagram(turn, body))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer_datagram(self, turn: int, body: bytes) -> None:
        try:
            request = parse(RenderRequest, body)
            frame = await self._source.submit(self._session.client, request)
        except Exception as error:
            self._sender.send_problem(_seq(body), b"".join(_failure(error, body)))
        else:
            self._sender.send_frame(turn, request.seq, b"".join(_success(frame)))


def _success(frame: Frame) -> tuple[bytes, bytes]:
    header = FrameHeader(
        status=200,
        seq=frame.seq,
        content_type=frame.content_type,
        width=frame.width,
        height=frame.height,
        profile=frame.profile,
        timing=frame.timing,
    )
    return _head(header), frame.body


def _failure(error: Exception, body: bytes) -> tuple[bytes, bytes]:
    if not isinstance(error, TigasError):
        logger.error("A render request failed", exc_info=error)
    about = problem(error)
    header = FrameHeader(status=about.status, seq=_seq(body), content_type="application/problem+json")
    return _head(header), about.model_dump_json().encode()


def _head(header: FrameHeader) -> bytes:
    text = header.model_dump_json().encode()
    return struct.pack("!I", len(text)) + text


def _seq(body: bytes) -> int:
    """The number of a request that could not be read, as far as it can be told; 0 otherwise."""
    try:
        seq = json.loads(body)["seq"]
    except (ValueError, TypeError, KeyError, RecursionError):
        return 0
    return seq if type(seq) is int and 0 <= seq < 2**32 else 0
