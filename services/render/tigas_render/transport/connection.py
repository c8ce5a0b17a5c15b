"""One client's QUIC connection: events in, streams and sessions out, packets on their way."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol
from urllib.parse import urlsplit

from aioquic.buffer import encode_uint_var
from aioquic.h3.connection import ErrorCode, FrameType, encode_frame
from aioquic.h3.events import (
    DatagramReceived,
    DataReceived,
    H3Event,
    HeadersReceived,
    WebTransportStreamDataReceived,
)
from aioquic.quic.events import (
    ConnectionIdIssued,
    ConnectionIdRetired,
    ConnectionTerminated,
    HandshakeCompleted,
    ProtocolNegotiated,
    QuicEvent,
    StopSendingReceived,
    StreamReset,
)

from tigas_render.transport.asgi import App
from tigas_render.transport.gso import Address, Datagram
from tigas_render.transport.http import HttpRequest
from tigas_render.transport.limits import Limits
from tigas_render.transport.quic import ServerH3Connection, ServerQuicConnection
from tigas_render.transport.stream import Stream
from tigas_render.transport.webtransport import (
    DRAFT_HEADER,
    SessionHandler,
    WebTransportSession,
    WebTransportStream,
)
from tigas_render.transport.writer import Writer

logger = logging.getLogger(__name__)

BUFFERED_STREAM_REJECTED = 0x3994BD84
"""WebTransport's error for a stream of a session that does not exist."""

_now = time.monotonic
"""The event loop's own clock, read afresh: uvloop's `time()` stands still within an iteration and ticks in
milliseconds, too coarse for round trips and pacing."""


class Listener(Protocol):
    """What a connection needs of the server."""

    def send(self, datagrams: list[Datagram]) -> None:
        """Put datagrams on the network."""

    def issued(self, connection: Connection, cid: bytes) -> None:
        """The client may use this connection id from now on."""

    def retired(self, connection: Connection, cid: bytes) -> None:
        """The client does not use this connection id any more."""

    def terminated(self, connection: Connection) -> None:
        """The connection is over."""


@dataclass(frozen=True, slots=True)
class Service:
    """What is served, the same for every connection."""

    app: App
    webtransport: Mapping[str, SessionHandler]
    limits: Limits = field(default_factory=Limits)
    early_posts: frozenset[str] = frozenset({"/render"})
    """Paths whose POST is idempotent, so that it may arrive as early data."""


class Connection:
    """Drives one aioquic connection: time and datagrams in, datagrams out, a task for every request."""

    def __init__(
        self,
        quic: ServerQuicConnection,
        listener: Listener,
        service: Service,
        client: tuple[str, int],
        server: tuple[str, int],
    ) -> None:
        self.service = service
        self.client = client
        self.server = server
        self.writer = Writer(quic, service.limits, self.transmit_soon)
        self._quic = quic
        self._listener = listener
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_at: float | None = None
        self._transmit_handle: asyncio.Handle | None = None
        self._streams: dict[int, Stream] = {}
        self._sessions: dict[int, WebTransportSession] = {}
        self._session_tasks: set[asyncio.Task[None]] = set()
        self._abandoned = False
        self._next_request = 0
        self._goaway: int | None = None
        self._idle: asyncio.Future[None] | None = None
        self._handshake_timer = self._loop.call_later(service.limits.handshake_timeout, self._handshake_late)

    # -- state -------------------------------------------------------------------------------------------------------

    @property
    def is_established(self) -> bool:
        """Whether the handshake is complete; requests that came before it may be replays."""
        return self._quic.is_established

    @property
    def running(self) -> int:
        """Requests and streams that are being answered."""
        return len(self._streams)

    # -- network -----------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, address: Address) -> None:
        """Take one datagram; `transmit` must follow once all that have arrived are in."""
        try:
            self._quic.receive_datagram(data, address, now=_now())
            self._process_events()
        except Exception:
            self._fail()

    def transmit(self) -> None:
        """Send what may be sent now, and arm the timer for the rest."""
        if self._transmit_handle is not None:
            self._transmit_handle.cancel()
            self._transmit_handle = None
        try:
            if not self._abandoned:
                self._transmit()
        except Exception:
            self._fail()

    def transmit_soon(self) -> None:
        """Send once the running callbacks are done, so that many writes share packets."""
        if self._transmit_handle is None and not self._abandoned:
            self._transmit_handle = self._loop.call_soon(self.transmit)

    def _transmit(self) -> None:
        more = True
        while more:
            more = self.writer.hand_over_datagrams(self._sessions.values())
            datagrams = self._quic.datagrams_to_send(now=_now())
            if not datagrams:
                break
            self._listener.send(datagrams)
        self.writer.wake()
        timer_at = self._quic.get_timer()
        if timer_at != self._timer_at:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None if timer_at is None else self._loop.call_at(timer_at, self._handle_timer)
            self._timer_at = timer_at

    def _handle_timer(self) -> None:
        assert self._timer_at is not None
        now = max(self._timer_at, _now())
        self._timer = self._timer_at = None
        try:
            self._quic.handle_timer(now=now)
            self._process_events()
        except Exception:
            self._fail()
        self.transmit()

    def _fail(self) -> None:
        """Whatever a client manages to provoke ends its own connection and no other."""
        logger.exception("The connection from %s failed", self.client[0])
        self.abandon()
        self._listener.terminated(self)

    def _handshake_late(self) -> None:
        if not self.is_established:
            self.close(ErrorCode.H3_NO_ERROR, "The handshake took too long")

    # -- closing -----------------------------------------------------------------------------------------------------

    def go_away(self) -> None:
        """Tell the client to open no further requests here; those that it has opened are still answered."""
        if self.writer.h3 is None or self._goaway is not None:
            return
        self._goaway = self._next_request
        frame = encode_frame(FrameType.GOAWAY, encode_uint_var(self._goaway))
        self._quic.send_stream_data(self.writer.h3.control_stream_id, frame)
        self.transmit()

    async def finish(self) -> None:
        """Wait until nothing is being answered."""
        while self._streams:
            self._idle = self._loop.create_future()
            await self._idle

    async def end_tasks(self) -> None:
        """Cancel the tasks of a closed connection that have not ended by themselves, and wait for them."""
        tasks = {stream.task for stream in self._streams.values() if stream.task is not None} | self._session_tasks
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    def close(self, error_code: int = ErrorCode.H3_NO_ERROR, reason: str = "") -> None:
        """Close the connection; whatever is running ends as if the client had cancelled it."""
        self._quic.close(error_code=error_code, reason_phrase=reason)
        self._end_everything()
        self.transmit()

    def abandon(self) -> None:
        """Forget the connection without a word to the client: no more timers, no more tasks."""
        self._abandoned = True
        self._handshake_timer.cancel()
        if self._timer is not None:
            self._timer.cancel()
        if self._transmit_handle is not None:
            self._transmit_handle.cancel()
        self._end_everything()

    def _end_everything(self) -> None:
        self._handshake_timer.cancel()
        for session in list(self._sessions.values()):
            session.close()
        for stream in list(self._streams.values()):
            stream.cancelled()
        self.writer.close()

    # -- events ------------------------------------------------------------------------------------------------------

    def _process_events(self) -> None:
        while (event := self._quic.next_event()) is not None:
            match event:
                case ConnectionIdIssued():
                    self._listener.issued(self, event.connection_id)
                case ConnectionIdRetired():
                    self._listener.retired(self, event.connection_id)
                case ConnectionTerminated():
                    self._end_everything()
                    self._listener.terminated(self)
                case HandshakeCompleted():
                    self._handshake_timer.cancel()
                case ProtocolNegotiated():
                    self.writer.h3 = ServerH3Connection(self._quic, enable_webtransport=True)
                case _:
                    self._stream_event(event)

    def _stream_event(self, event: QuicEvent) -> None:
        if self.writer.h3 is None:
            return
        for h3_event in self.writer.h3.handle_event(event):
            self._h3_event(h3_event)
        if isinstance(event, StopSendingReceived | StreamReset):
            if (session := self._sessions.get(event.stream_id)) is not None:
                session.close()
            elif (stream := self._streams.get(event.stream_id)) is not None:
                stream.cancelled()

    def _h3_event(self, event: H3Event) -> None:
        match event:
            case WebTransportStreamDataReceived():
                self._webtransport_data(event)
            case DatagramReceived():
                if (session := self._sessions.get(event.stream_id)) is not None:
                    session.datagram_received(event.data)
            case HeadersReceived():
                if (stream := self._streams.get(event.stream_id)) is not None:  # trailers
                    stream.data_received(b"", event.stream_ended)
                elif event.stream_id not in self._sessions and self.writer.is_open(event.stream_id):
                    self._request_received(event)
            case DataReceived():
                if (session := self._sessions.get(event.stream_id)) is not None:
                    session.capsules_received(event.stream_ended)
                elif (stream := self._streams.get(event.stream_id)) is not None:
                    stream.data_received(event.data, event.stream_ended)

    def _request_received(self, event: HeadersReceived) -> None:
        stream_id = event.stream_id
        self._next_request = max(self._next_request, stream_id + 4)
        if self._goaway is not None and stream_id >= self._goaway:
            self.writer.abort(stream_id, ErrorCode.H3_REQUEST_REJECTED)
            return
        pseudo = {name: value for name, value in event.headers if name.startswith(b":")}
        if pseudo[b":method"] == b"CONNECT":
            self._connect_received(stream_id, pseudo)
            return
        request = HttpRequest(self, stream_id, event.headers, refuse=self._refusal(pseudo))
        if event.stream_ended:
            request.data_received(b"", True)
        self._start(request)

    def _refusal(self, pseudo: Mapping[bytes, bytes]) -> int | None:
        """The status of a request that does not reach the application."""
        if self.running >= self.service.limits.requests:
            return 503
        if not self.is_established and pseudo[b":method"] not in (b"GET", b"HEAD"):
            path = urlsplit(pseudo.get(b":path", b"")).path.decode("latin-1")
            if pseudo[b":method"] != b"POST" or path not in self.service.early_posts:
                return 425  # Too Early (RFC 8470): it may be a replay
        return None

    def _connect_received(self, stream_id: int, pseudo: Mapping[bytes, bytes]) -> None:
        path = pseudo.get(b":path", b"").partition(b"?")[0].decode("latin-1")
        handler = self.service.webtransport.get(path)
        if pseudo.get(b":protocol") != b"webtransport":
            self._refuse_connect(stream_id, b"501")
        elif handler is None:
            self._refuse_connect(stream_id, b"404")
        elif len(self._sessions) >= self.service.limits.sessions:
            self._refuse_connect(stream_id, b"429")
        else:
            self.writer.headers(stream_id, [(b":status", b"200"), DRAFT_HEADER])
            session = self._sessions[stream_id] = WebTransportSession(self, stream_id, path, handler)
            self._session_tasks.add(session.task)
            session.task.add_done_callback(self._session_tasks.discard)

    def _refuse_connect(self, stream_id: int, status: bytes) -> None:
        self.writer.headers(stream_id, [(b":status", status)], end=True)
        self.writer.abort(stream_id, ErrorCode.H3_NO_ERROR)

    def _webtransport_data(self, event: WebTransportStreamDataReceived) -> None:
        stream_id = event.stream_id
        stream = self._streams.get(stream_id)
        if stream is None:
            session = self._sessions.get(event.session_id)
            if session is None or stream_id % 4 != 0 or self._goaway is not None:
                self.writer.abort(stream_id, BUFFERED_STREAM_REJECTED)
                return
            if not self.writer.is_open(stream_id):  # answered already; the client has not stopped yet
                return
            stream = WebTransportStream(
                self, stream_id, session, overloaded=self.running >= self.service.limits.requests
            )
            stream.data_received(event.data, event.stream_ended)
            self._start(stream)
        else:
            stream.data_received(event.data, event.stream_ended)

    # -- streams -----------------------------------------------------------------------------------------------------

    def _start(self, stream: Stream) -> None:
        self._streams[stream.stream_id] = stream
        stream.task = self._loop.create_task(stream.run())
        # A callback, because a task that is cancelled before it starts never enters its own `finally`.
        stream.task.add_done_callback(lambda task: self._ended(stream, task))

    def _ended(self, stream: Stream, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            logger.error("A stream's handler failed", exc_info=error)
        del self._streams[stream.stream_id]
        self.writer.abort(stream.stream_id, stream.abort_code)
        if self._idle is not None and not self._streams and not self._idle.done():
            self._idle.set_result(None)

    def session_closed(self, session: WebTransportSession) -> None:
        """Forget a session and cancel its streams."""
        if self._sessions.pop(session.stream_id, None) is None:
            return
        for stream in list(self._streams.values()):
            if isinstance(stream, WebTransportStream) and stream.session is session:
                stream.cancelled()
        self.writer.raw(session.stream_id, b"", end=True)
        self.writer.abort(session.stream_id, ErrorCode.H3_NO_ERROR)
