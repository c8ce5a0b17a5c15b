"""Brings what arrives on a connection to the request or session that it is for."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from aioquic.h3.connection import ErrorCode
from aioquic.h3.events import (
    DatagramReceived,
    DataReceived,
    H3Event,
    HeadersReceived,
    WebTransportStreamDataReceived,
)

from tigas_render.transport.http import HttpRequest
from tigas_render.transport.stream import Stream
from tigas_render.transport.webtransport import DRAFT_HEADER, WebTransportSession, WebTransportStream

if TYPE_CHECKING:
    from tigas_render.transport.connection import Connection

logger = logging.getLogger(__name__)

BUFFERED_STREAM_REJECTED = 0x3994BD84
"""WebTransport's error for a stream of a session that does not exist."""


class Router:
    """All that a client has open on one connection: a task for every request, session and stream."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._service = connection.service
        self._writer = connection.writer
        self._streams: dict[int, Stream] = {}
        self._sessions: dict[int, WebTransportSession] = {}
        self._session_tasks: set[asyncio.Task[None]] = set()
        self._next_request = 0
        self._goaway: int | None = None
        self._idle: asyncio.Future[None] | None = None

    @property
    def running(self) -> int:
        """Requests and streams that are being answered."""
        return len(self._streams)

    @property
    def sessions(self) -> Collection[WebTransportSession]:
        """WebTransport sessions that are open."""
        return self._sessions.values()

    # -- ending ------------------------------------------------------------------------------------------------------

    def go_away(self) -> int:
        """Take no further requests from now on; the id of the first that is refused."""
        if self._goaway is None:
            self._goaway = self._next_request
        return self._goaway

    async def finish(self) -> None:
        """Wait until nothing is being answered."""
        while self._streams:
            self._idle = asyncio.get_running_loop().create_future()
            await self._idle

    def end_everything(self) -> None:
        """End whatever is running as if the client had cancelled it."""
        for session in list(self._sessions.values()):
            session.close()
        for stream in list(self._streams.values()):
            stream.cancelled()

    async def end_tasks(self) -> None:
        """Cancel the tasks that have not ended by themselves, and wait for them."""
        tasks = {stream.task for stream in self._streams.values() if stream.task is not None} | self._session_tasks
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    # -- events ------------------------------------------------------------------------------------------------------

    def received(self, event: H3Event) -> None:
        """Bring an event to whom it is for."""
        match event:
            case WebTransportStreamDataReceived():
                self._webtransport_data(event)
            case DatagramReceived():
                if (session := self._sessions.get(event.stream_id)) is not None:
                    session.datagram_received(event.data)
            case HeadersReceived():
                if (stream := self._streams.get(event.stream_id)) is not None:  # trailers
                    stream.data_received(b"", event.stream_ended)
                elif event.stream_id not in self._sessions and self._writer.is_open(event.stream_id):
                    self._request_received(event)
            case DataReceived():
                if (session := self._sessions.get(event.stream_id)) is not None:
                    session.capsules_received(event.stream_ended)
                elif (stream := self._streams.get(event.stream_id)) is not None:
                    stream.data_received(event.data, event.stream_ended)

    def cancelled(self, stream_id: int) -> None:
        """The client reads no more of a stream, or has reset its side."""
        if (session := self._sessions.get(stream_id)) is not None:
            session.close()
        elif (stream := self._streams.get(stream_id)) is not None:
            stream.cancelled()

    def _request_received(self, event: HeadersReceived) -> None:
        stream_id = event.stream_id
        self._next_request = max(self._next_request, stream_id + 4)
        if self._goaway is not None and stream_id >= self._goaway:
            self._writer.abort(stream_id, ErrorCode.H3_REQUEST_REJECTED)
            return
        pseudo = {name: value for name, value in event.headers if name.startswith(b":")}
        if pseudo[b":method"] == b"CONNECT":
            self._connect_received(stream_id, pseudo)
            return
        request = HttpRequest(self._connection, stream_id, event.headers, refuse=self._refusal(pseudo))
        if event.stream_ended:
            request.data_received(b"", True)
        self._start(request)

    def _refusal(self, pseudo: Mapping[bytes, bytes]) -> int | None:
        """The status of a request that does not reach the application."""
        if self.running >= self._service.limits.requests:
            return 503
        if not self._connection.is_established and pseudo[b":method"] not in (b"GET", b"HEAD"):
            path = urlsplit(pseudo.get(b":path", b"")).path.decode("latin-1")
            if pseudo[b":method"] != b"POST" or path not in self._service.early_posts:
                return 425  # Too Early (RFC 8470): it may be a replay
        return None

    def _connect_received(self, stream_id: int, pseudo: Mapping[bytes, bytes]) -> None:
        path = pseudo.get(b":path", b"").partition(b"?")[0].decode("latin-1")
        handler = self._service.webtransport.get(path)
        if pseudo.get(b":protocol") != b"webtransport":
            self._refuse_connect(stream_id, b"501")
        elif handler is None:
            self._refuse_connect(stream_id, b"404")
        elif len(self._sessions) >= self._service.limits.sessions:
            self._refuse_connect(stream_id, b"429")
        else:
            self._writer.headers(stream_id, [(b":status", b"200"), DRAFT_HEADER])
            session = self._sessions[stream_id] = WebTransportSession(self._connection, stream_id, path, handler)
            self._session_tasks.add(session.task)
            session.task.add_done_callback(self._session_tasks.discard)

    def _refuse_connect(self, stream_id: int, status: bytes) -> None:
        self._writer.headers(stream_id, [(b":status", status)], end=True)
        self._writer.abort(stream_id, ErrorCode.H3_NO_ERROR)

    def _webtransport_data(self, event: WebTransportStreamDataReceived) -> None:
        stream_id = event.stream_id
        stream = self._streams.get(stream_id)
        if stream is None:
            session = self._sessions.get(event.session_id)
            if session is None or stream_id % 4 != 0 or self._goaway is not None:
                self._writer.abort(stream_id, BUFFERED_STREAM_REJECTED)
                return
            if not self._writer.is_open(stream_id):  # answered already; the client has not stopped yet
                return
            stream = WebTransportStream(
                self._connection, stream_id, session, overloaded=self.running >= self._service.limits.requests
            )
            stream.data_received(event.data, event.stream_ended)
            self._start(stream)
        else:
            stream.data_received(event.data, event.stream_ended)

    # -- streams -----------------------------------------------------------------------------------------------------

    def _start(self, stream: Stream) -> None:
        self._streams[stream.stream_id] = stream
        stream.task = asyncio.create_task(stream.run())
        # A callback, because a task that is cancelled before it starts never enters its own `finally`.
        stream.task.add_done_callback(lambda task: self._ended(stream, task))

    def _ended(self, stream: Stream, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            logger.error("A stream's handler failed", exc_info=error)
        del self._streams[stream.stream_id]
        self._writer.abort(stream.stream_id, stream.abort_code)
        if self._idle is not None and not self._streams and not self._idle.done():
            self._idle.set_result(None)

    def session_closed(self, session: WebTransportSession) -> None:
        """Forget a session and cancel its streams."""
        if self._sessions.pop(session.stream_id, None) is None:
            return
        for stream in list(self._streams.values()):
            if isinstance(stream, WebTransportStream) and stream.session is session:
                stream.cancelled()
        self._writer.raw(session.stream_id, b"", end=True)
        self._writer.abort(session.stream_id, ErrorCode.H3_NO_ERROR)
