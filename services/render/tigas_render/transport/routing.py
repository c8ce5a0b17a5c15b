"""HTTP/3 on one connection: brings what arrives to the request or session that it is for."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from aioquic.buffer import encode_uint_var
from aioquic.h3.connection import ErrorCode, FrameType, encode_frame
from aioquic.h3.events import (
    DatagramReceived,
    DataReceived,
    H3Event,
    HeadersReceived,
    WebTransportStreamDataReceived,
)
from aioquic.quic.events import QuicEvent, StopSendingReceived, StreamDataReceived, StreamReset
from starlette.types import ASGIApp

from tigas_common.errors import TigasError, problem
from tigas_common.origins import OriginPolicy
from tigas_common.web import problem_response
from tigas_render.transport.h3 import ServerH3Connection
from tigas_render.transport.http import HttpRequest, http_scope, refusal
from tigas_render.transport.limits import Limits
from tigas_render.transport.load import FULL, Load
from tigas_render.transport.outlet import DatagramOutlet, Outlet, Writer
from tigas_render.transport.quic import ServerQuicConnection
from tigas_render.transport.unfinished import UnfinishedStreams
from tigas_render.transport.usage import Usage
from tigas_render.transport.webtransport import DRAFT_HEADER, SessionFactory, WebTransportSession, WebTransportStream

BUFFERED_STREAM_REJECTED = 0x3994BD84
"""WebTransport's error for a stream of a session that does not exist."""
TOO_EARLY = "This request may not be sent before the connection is established; send it again."


class Stream(Protocol):
    """What is on a bidirectional stream that a client opened: an HTTP request, or one stream of a session."""

    outlet: Outlet
    abort_code: int
    """The error code for a stream that is over before it is finished."""

    @property
    def task(self) -> asyncio.Task[None] | None:
        """What answers, if that is a task."""

    def start(self, ended: Callable[[], None]) -> None:
        """Answer the client; `ended` is called once when there is nothing more to do. What is not finished is reset."""

    def data_received(self, data: bytes, ended: bool, arrived: float) -> None:
        """The next part of what the client sends; `ended` with the last."""

    def cancelled(self) -> None:
        """The client wants no answer any more, has reset its side, or is gone."""


@dataclass(frozen=True, slots=True)
class Service:
    """What is served, the same for every connection."""

    app: ASGIApp
    webtransport: Mapping[str, SessionFactory]
    """By path."""
    limits: Limits = field(default_factory=Limits)
    load: Load = field(default_factory=Load)
    origins: OriginPolicy = field(default_factory=OriginPolicy)
    """Which pages may open sessions."""
    early_posts: frozenset[str] = frozenset({"/render"})
    """Paths whose POST is idempotent, so that it may arrive as early data."""


class Router:
    """All that a client has open: requests, sessions, and their streams."""

    def __init__(
        self,
        quic: ServerQuicConnection,
        service: Service,
        client: tuple[str, int],
        server: tuple[str, int],
        usage: Usage,
        transmit_soon: Callable[[], None],
    ) -> None:
        """usage: what the client's address uses, which counts here."""
        self._quic = quic
        self._service = service
        self._client = client
        self._server = server
        self._usage = usage
        self._counted = 0
        """How many requests are counted in `usage`."""
        self._h3 = ServerH3Connection(quic, enable_webtransport=True)
        self.writer = Writer(quic, self._h3, service.limits, transmit_soon)
        self._streams: dict[int, Stream] = {}
        self._sessions: dict[int, WebTransportSession] = {}
        self._unfinished = UnfinishedStreams(service.limits.request_timeout)
        self._next_request = 0
        self._goaway: int | None = None
        self._idle: asyncio.Future[None] | None = None

    # -- ending ------------------------------------------------------------------------------------------------------

    def go_away(self) -> None:
        """Tell the client to open no further requests here; those that it has opened are still answered."""
        if self._goaway is None:
            self._goaway = self._next_request
            frame = encode_frame(FrameType.GOAWAY, encode_uint_var(self._goaway))
            self._quic.send_stream_data(self._h3.control_stream_id, frame)
            self.writer.transmit_soon()

    async def finish(self) -> None:
        """Wait until nothing is being answered."""
        while self._streams:
            self._idle = asyncio.get_running_loop().create_future()
            await self._idle

    def close(self) -> None:
        """End whatever is running as if the client had cancelled it."""
        for stream_id in list(self._sessions):
            self._close_session(stream_id)
        for stream in list(self._streams.values()):
            stream.cancelled()
        self._unfinished.clear()
        self._count()
        self.writer.close()

    async def end_tasks(self) -> None:
        """Cancel the tasks that have not ended by themselves, and wait for them."""
        tasks = [stream.task for stream in self._streams.values() if stream.task is not None]
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    # -- from the client ---------------------------------------------------------------------------------------------

    def received(self, event: QuicEvent, arrived: float) -> None:
        """Bring an event to whom it is for.

        A request arrives with the datagram that completes it, the last to come of all that it needs: before that there
        is nothing to answer.
        """
        for h3_event in self._h3.handle_event(event):
            self._received(h3_event, arrived)
        if isinstance(event, StopSendingReceived | StreamReset):
            self._cancelled(event.stream_id)
        if isinstance(event, StreamDataReceived | StopSendingReceived | StreamReset):
            self._watch(event.stream_id, arrived)

    def _received(self, event: H3Event, arrived: float) -> None:
        match event:
            case WebTransportStreamDataReceived():
                self._webtransport_data(event, arrived)
            case DatagramReceived():
                if (session := self._sessions.get(event.stream_id)) is not None:
                    session.handler.datagram(event.data, arrived)
            case HeadersReceived():
                if event.stream_id in self._streams or event.stream_id in self._sessions:  # trailers
                    self._data(event.stream_id, b"", event.stream_ended, arrived)
                else:
                    self._request_received(event, arrived)
            case DataReceived():
                self._data(event.stream_id, event.data, event.stream_ended, arrived)

    def _data(self, stream_id: int, data: bytes, ended: bool, arrived: float) -> None:
        if (stream := self._streams.get(stream_id)) is not None:
            stream.data_received(data, ended, arrived)
        elif ended:  # of a session only its end matters: no capsule needs an answer
            self._close_session(stream_id)

    def _cancelled(self, stream_id: int) -> None:
        """The client reads no more of a stream, or has reset its side."""
        if (stream := self._streams.get(stream_id)) is not None:
            stream.cancelled()
        elif stream_id in self._sessions:
            self._close_session(stream_id)
        else:  # its answer is with QUIC already; whose it was is not known any more
            for session in self._sessions.values():
                session.handler.stopped()

    # -- what is not finished ----------------------------------------------------------------------------------------

    @property
    def deadline(self) -> float | None:
        """When `end_late` is to be called next."""
        return self._unfinished.deadline

    def end_late(self, now: float) -> None:
        """End the streams whose first frame has not arrived in time."""
        for stream_id in self._unfinished.late(now):
            self._unfinished.end(stream_id)
            if stream_id % 4 == 0:
                Outlet(self.writer, stream_id).abort(ErrorCode.H3_REQUEST_INCOMPLETE)
            else:  # the connection cannot do without its control stream
                self._quic.close(error_code=ErrorCode.H3_EXCESSIVE_LOAD, reason_phrase="A frame was never finished")
        self._count()

    def watch(self, stream_ids: Collection[int], arrived: float) -> None:
        """Note streams that something has come for, though perhaps not what they begin with."""
        for stream_id in stream_ids:
            self._watch(stream_id, arrived)

    def _watch(self, stream_id: int, arrived: float) -> None:
        """Note whether a stream still waits for what makes it a request, a session, or a session's stream."""
        if stream_id % 4 != 0:
            waits = self._h3.is_cut(stream_id) or self._quic.has_gap(stream_id)
        else:
            answered = stream_id in self._streams or stream_id in self._sessions
            waits = not answered and self._quic.can_write(stream_id)
        if not waits:
            self._unfinished.end(stream_id)
        elif stream_id % 4 == 0 and stream_id not in self._unfinished and self._overload() is not None:
            Outlet(self.writer, stream_id).abort(ErrorCode.H3_REQUEST_REJECTED)
        else:
            self._unfinished.begin(stream_id, arrived)
        self._count()

    # -- requests ----------------------------------------------------------------------------------------------------

    def _request_received(self, event: HeadersReceived, arrived: float) -> None:
        self._unfinished.end(event.stream_id)
        outlet = Outlet(self.writer, event.stream_id)
        if not outlet.is_open:
            return
        self._next_request = max(self._next_request, event.stream_id + 4)
        if self._goaway is not None and event.stream_id >= self._goaway:
            outlet.abort(ErrorCode.H3_REQUEST_REJECTED)
            return
        pseudo = {name: value for name, value in event.headers if name.startswith(b":")}
        if pseudo[b":method"] == b"CONNECT":
            app = self._connect_received(outlet, pseudo, dict(event.headers).get(b"origin"))
            if app is None:
                return
        else:
            app = self._refusal(pseudo) or self._service.app
        request = HttpRequest(outlet, http_scope(event.headers, self._client, self._server), app)
        if event.stream_ended:
            request.data_received(b"", True, arrived)
        self._start(request)

    def _refusal(self, pseudo: Mapping[bytes, bytes]) -> ASGIApp | None:
        """What answers a request that does not reach the application."""
        if (overload := self._overload()) is not None:
            return refusal(503, overload)
        if not self._quic.is_established and pseudo[b":method"] not in (b"GET", b"HEAD"):
            path = _path(pseudo)
            if pseudo[b":method"] != b"POST" or path not in self._service.early_posts:
                return refusal(425, TOO_EARLY)  # RFC 8470
        return None

    def _overload(self) -> str | None:
        """Why no further request is taken now."""
        self._count()
        if self._counted >= self._service.limits.requests:
            return "This connection has too many requests running."
        if self._usage.requests >= self._service.limits.requests_per_address:
            return "Your address has too many requests running."
        return None

    def _count(self) -> None:
        """Let the address's usage know what is open now."""
        now = len(self._streams) + len(self._unfinished)
        self._usage.requests += now - self._counted
        self._counted = now

    # -- WebTransport ------------------------------------------------------------------------------------------------

    def _connect_received(self, outlet: Outlet, pseudo: Mapping[bytes, bytes], origin: bytes | None) -> ASGIApp | None:
        """Open a session; what answers the client if there is none to be opened."""
        limits = self._service.limits
        make_handler = self._service.webtransport.get(_path(pseudo))
        if pseudo.get(b":protocol") != b"webtransport":
            return refusal(501, "Only WebTransport sessions are connected to.")
        if make_handler is None:
            return refusal(404, "There are no sessions at this path.")
        try:
            page = None if origin is None else origin.decode("latin-1")
            self._service.origins.check(pseudo[b":authority"].decode("latin-1"), page)
        except TigasError as error:
            return problem_response(problem(error))
        if len(self._sessions) >= limits.sessions:
            return refusal(429, "This connection has as many sessions as it may.")
        if self._usage.sessions >= limits.sessions_per_address:
            return refusal(429, "Your address has as many sessions as it may.")
        if (retry_after := self._service.load.full()) is not None:
            self._service.load.refused()
            return refusal(503, FULL, retry_after)
        self._service.load.entered()
        outlet.send_headers([(b":status", b"200"), DRAFT_HEADER])
        self._usage.sessions += 1
        self._sessions[outlet.stream_id] = WebTransportSession(
            outlet, DatagramOutlet(self.writer, outlet.stream_id), self._usage.address, make_handler
        )
        return None

    def _close_session(self, stream_id: int) -> None:
        session = self._sessions.pop(stream_id, None)
        if session is None:
            return
        self._usage.sessions -= 1
        self._service.load.left()
        for stream in list(self._streams.values()):
            if isinstance(stream, WebTransportStream) and stream.session is session:
                stream.cancelled()
        session.close()

    def _webtransport_data(self, event: WebTransportStreamDataReceived, arrived: float) -> None:
        if event.stream_id not in self._streams:
            self._unfinished.end(event.stream_id)
            outlet = Outlet(self.writer, event.stream_id)
            session = self._sessions.get(event.session_id)
            if session is None or event.stream_id % 4 != 0 or self._goaway is not None:
                outlet.abort(BUFFERED_STREAM_REJECTED)
                return
            if not outlet.is_open:  # answered already; the client has not stopped yet
                return
            self._start(WebTransportStream(outlet, session, self._overload()))
        if (stream := self._streams.get(event.stream_id)) is not None:
            stream.data_received(event.data, event.stream_ended, arrived)

    # -- streams -----------------------------------------------------------------------------------------------------

    def _start(self, stream: Stream) -> None:
        self._streams[stream.outlet.stream_id] = stream
        self._count()
        stream.start(partial(self._ended, stream))

    def _ended(self, stream: Stream) -> None:
        del self._streams[stream.outlet.stream_id]
        self._count()
        stream.outlet.abort(stream.abort_code)
        if self._idle is not None and not self._streams and not self._idle.done():
            self._idle.set_result(None)


def _path(pseudo: Mapping[bytes, bytes]) -> str:
    """The path of a request, without its query."""
    return pseudo.get(b":path", b"").partition(b"?")[0].decode("latin-1")
