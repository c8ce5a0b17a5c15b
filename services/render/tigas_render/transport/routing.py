"""HTTP/3 on one connection: the router that dispatches events to requests and sessions."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import partial

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

from tigas_common.errors import TigasError
from tigas_common.origins import OriginPolicy
from tigas_common.web import error_response
from tigas_render.admission.connections import Usage
from tigas_render.admission.limits import Limits
from tigas_render.admission.load import Load
from tigas_render.frame import Client
from tigas_render.transport.aioquic_ext.h3 import ServerH3Connection
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.frames import DRAFT_HEADER, RenderSession, SessionFactory, WebTransportStream
from tigas_render.transport.http import HttpRequest, http_scope, refusal_app
from tigas_render.transport.sending import SendScheduler, StreamWriter

BUFFERED_STREAM_REJECTED = 0x3994BD84
"""WebTransport's error code for a stream of an unknown session."""
EARLY_POST = (b"POST", "/render")
"""The method and path of an idempotent request, which is therefore allowed as early data."""
TOO_EARLY = "This request may not be sent before the connection is established; send it again."


Stream = HttpRequest | WebTransportStream
"""A bidirectional stream opened by a client."""

_numbers = itertools.count(1)
"""Session numbers, unique in this process."""


@dataclass(frozen=True, slots=True)
class Service:
    """The served application and sessions, shared by all connections."""

    app: ASGIApp
    webtransport: Mapping[str, SessionFactory]
    """Session factories by path."""
    limits: Limits = field(default_factory=Limits)
    load: Load = field(default_factory=Load)
    origins: OriginPolicy = field(default_factory=OriginPolicy)
    """The pages that may open sessions."""


class Router:
    """A client's open requests and sessions, and their streams."""

    def __init__(
        self,
        quic: ServerQuicConnection,
        service: Service,
        client: tuple[str, int],
        server: tuple[str, int],
        usage: Usage,
        transmit_soon: Callable[[], None],
    ) -> None:
        """usage: resource usage of the client's address, updated here."""
        self._quic = quic
        self._service = service
        self._client = client
        self._server = server
        self._usage = usage
        self._counted = 0
        """Number of this connection's requests that are counted in `usage`."""
        self._h3 = ServerH3Connection(quic, enable_webtransport=True)
        self.scheduler = SendScheduler(quic, self._h3, service.limits, usage, transmit_soon)
        self._streams: dict[int, Stream] = {}
        self._sessions: dict[int, RenderSession] = {}
        self._unfinished: dict[int, float] = {}
        """Since when each stream has been waiting for the rest of its first frame, oldest first."""
        self._next_request = 0
        self._goaway: int | None = None
        self._idle: asyncio.Future[None] | None = None
        self._is_unresponsive = False

    def go_away(self) -> None:
        """Ask the client to send no further requests on this connection; open ones are still answered."""
        if self._goaway is None:
            self._goaway = self._next_request
            frame = encode_frame(FrameType.GOAWAY, encode_uint_var(self._goaway))
            self._quic.send_stream_data(self._h3.control_stream_id, frame)
            self.scheduler.transmit_soon()

    async def drain(self) -> None:
        """Wait until all requests are answered."""
        while self._streams:
            self._idle = asyncio.get_running_loop().create_future()
            await self._idle

    def close(self) -> None:
        """End all requests as if the client had cancelled them."""
        for stream_id in list(self._sessions):
            self._close_session(stream_id)
        for stream in list(self._streams.values()):
            stream.cancel()
        self._unfinished.clear()
        self._update_usage()
        self.scheduler.close()

    async def cancel_tasks(self) -> None:
        """Cancel the tasks that are still running, and wait for them."""
        tasks = [stream.task for stream in self._streams.values() if stream.task is not None]
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    def set_unresponsive(self, is_unresponsive: bool) -> None:
        """Stop counting the sessions of a client that seems to be gone as viewers, until it is back."""
        if is_unresponsive != self._is_unresponsive:
            self._is_unresponsive = is_unresponsive
            self._service.load.viewers += -len(self._sessions) if is_unresponsive else len(self._sessions)

    def handle_event(self, event: QuicEvent, arrived: float) -> None:
        """Dispatch an event to its request or session.

        arrived: when the event's datagram arrived; a request arrives with the datagram that completes it.
        """
        for h3_event in self._h3.handle_event(event):
            self._handle_h3_event(h3_event, arrived)
        if isinstance(event, StopSendingReceived | StreamReset):
            self._handle_cancel(event.stream_id)
        if isinstance(event, StreamDataReceived | StopSendingReceived | StreamReset):
            self._watch_stream(event.stream_id, arrived)

    def _handle_h3_event(self, event: H3Event, arrived: float) -> None:
        match event:
            case WebTransportStreamDataReceived():
                self._handle_webtransport_data(event, arrived)
            case DatagramReceived():
                if (session := self._sessions.get(event.stream_id)) is not None:
                    session.handle_datagram(event.data, arrived)
            case HeadersReceived():
                if event.stream_id in self._streams or event.stream_id in self._sessions:  # trailers
                    self._handle_data(event.stream_id, b"", event.stream_ended, arrived)
                else:
                    self._handle_request(event, arrived)
            case DataReceived():
                self._handle_data(event.stream_id, event.data, event.stream_ended, arrived)

    def _handle_data(self, stream_id: int, data: bytes, end_stream: bool, arrived: float) -> None:
        if (stream := self._streams.get(stream_id)) is not None:
            stream.data_received(data, end_stream, arrived)
        elif end_stream:  # the end of a session's own stream; its capsules need no answer
            self._close_session(stream_id)

    def _handle_cancel(self, stream_id: int) -> None:
        """Handle a stream that the client has stopped reading or reset."""
        if (stream := self._streams.get(stream_id)) is not None:
            stream.cancel()
        elif stream_id in self._sessions:
            self._close_session(stream_id)
        else:  # the answer is already queued in QUIC, so its session is no longer known
            for session in self._sessions.values():
                session.handle_missed_answer()

    @property
    def next_deadline(self) -> float | None:
        """When to call `abort_late_streams` next."""
        return next((since + self._service.limits.request_timeout for since in self._unfinished.values()), None)

    def abort_late_streams(self, now: float) -> None:
        """End the streams with an overdue first frame, even if parts of it keep arriving."""
        while (deadline := self.next_deadline) is not None and deadline <= now:
            stream_id = next(iter(self._unfinished))
            del self._unfinished[stream_id]
            if stream_id % 4 == 0:
                StreamWriter(self.scheduler, stream_id).abort(ErrorCode.H3_REQUEST_INCOMPLETE)
            else:  # the connection cannot do without its control stream
                self._quic.close(error_code=ErrorCode.H3_EXCESSIVE_LOAD, reason_phrase="A frame was never finished")
        self._update_usage()

    def watch_streams(self, stream_ids: Collection[int], arrived: float) -> None:
        """Watch streams that have received data but perhaps not their whole first frame."""
        for stream_id in stream_ids:
            self._watch_stream(stream_id, arrived)

    def _watch_stream(self, stream_id: int, arrived: float) -> None:
        """Record whether a stream is still waiting for its whole first frame, which makes it a request, a session, or
        a session's stream.
        """
        if stream_id % 4 != 0:
            waits = self._h3.has_partial_frame(stream_id) or self._quic.has_gap(stream_id)
        else:
            answered = stream_id in self._streams or stream_id in self._sessions
            waits = not answered and self._quic.can_write(stream_id)
        if not waits:
            self._unfinished.pop(stream_id, None)
        elif stream_id % 4 == 0 and stream_id not in self._unfinished and self._overload() is not None:
            StreamWriter(self.scheduler, stream_id).abort(ErrorCode.H3_REQUEST_REJECTED)
        else:
            self._unfinished.setdefault(stream_id, arrived)
        self._update_usage()

    def _handle_request(self, event: HeadersReceived, arrived: float) -> None:
        self._unfinished.pop(event.stream_id, None)
        writer = StreamWriter(self.scheduler, event.stream_id)
        if not writer.is_open:
            return
        self._next_request = max(self._next_request, event.stream_id + 4)
        if self._goaway is not None and event.stream_id >= self._goaway:
            writer.abort(ErrorCode.H3_REQUEST_REJECTED)
            return
        pseudo = {name: value for name, value in event.headers if name.startswith(b":")}
        if pseudo[b":method"] == b"CONNECT":
            app = self._handle_connect(writer, pseudo, dict(event.headers).get(b"origin"))
            if app is None:
                return
        else:
            app = self._refusal(pseudo) or self._service.app
        request = HttpRequest(writer, http_scope(event.headers, self._client, self._server), app)
        if event.stream_ended:
            request.data_received(b"", True, arrived)
        self._start_stream(request)

    def _refusal(self, pseudo: Mapping[bytes, bytes]) -> ASGIApp | None:
        """The application that refuses a request, if the service's own must not receive it."""
        if (overload := self._overload()) is not None:
            return refusal_app(503, overload)
        method = pseudo[b":method"]
        is_idempotent = method in (b"GET", b"HEAD") or (method, _path(pseudo)) == EARLY_POST
        return None if is_idempotent or self._quic.is_established else refusal_app(425, TOO_EARLY)  # RFC 8470

    def _overload(self) -> str | None:
        """Return the reason, if any, to refuse another request now."""
        self._update_usage()
        return self._usage.request_refusal(self._service.limits, self._counted)

    def _update_usage(self) -> None:
        """Update the address's usage."""
        now = len(self._streams) + len(self._unfinished)
        self._usage.requests += now - self._counted
        self._counted = now

    def _handle_connect(
        self, writer: StreamWriter, pseudo: Mapping[bytes, bytes], origin: bytes | None
    ) -> ASGIApp | None:
        """Open a session, or return the application that refuses it."""
        make_session = self._service.webtransport.get(_path(pseudo))
        if pseudo.get(b":protocol") != b"webtransport":
            return refusal_app(501, "CONNECT is only for WebTransport sessions.")
        if make_session is None:
            return refusal_app(404, "There are no sessions at this path.")
        load, stream_id = self._service.load, writer.stream_id
        try:
            page = None if origin is None else origin.decode("latin-1")
            self._service.origins.check(pseudo[b":authority"].decode("latin-1"), page)
            if (reason := self._usage.session_refusal(self._service.limits, len(self._sessions))) is not None:
                return refusal_app(429, reason)
            load.check_capacity()
        except TigasError as error:
            return error_response(error)
        self.set_unresponsive(False)
        load.add_viewer()
        writer.send_headers([(b":status", b"200"), DRAFT_HEADER])
        self._usage.sessions += 1
        client = Client(self._usage.address, f"session {next(_numbers)}", "webtransport")
        self._sessions[stream_id] = make_session(client, self.scheduler, stream_id)
        return None

    def _close_session(self, stream_id: int) -> None:
        self.set_unresponsive(False)
        session = self._sessions.pop(stream_id, None)
        if session is None:
            return
        self._usage.sessions -= 1
        self._service.load.viewers -= 1
        for stream in list(self._streams.values()):
            if isinstance(stream, WebTransportStream) and stream.session is session:
                stream.cancel()
        session.close()
        writer = StreamWriter(self.scheduler, stream_id)
        writer.end()
        writer.abort(ErrorCode.H3_NO_ERROR)

    def _handle_webtransport_data(self, event: WebTransportStreamDataReceived, arrived: float) -> None:
        if event.stream_id not in self._streams:
            self._unfinished.pop(event.stream_id, None)
            writer = StreamWriter(self.scheduler, event.stream_id)
            session = self._sessions.get(event.session_id)
            if session is None or event.stream_id % 4 != 0 or self._goaway is not None:
                writer.abort(BUFFERED_STREAM_REJECTED)
                return
            if not writer.is_open:  # already answered, while the client is still sending
                return
            self._start_stream(WebTransportStream(writer, session, self._overload()))
        if (stream := self._streams.get(event.stream_id)) is not None:
            stream.data_received(event.data, event.stream_ended, arrived)

    def _start_stream(self, stream: Stream) -> None:
        self._streams[stream.writer.stream_id] = stream
        self._update_usage()
        stream.start(partial(self._handle_stream_end, stream))

    def _handle_stream_end(self, stream: Stream) -> None:
        del self._streams[stream.writer.stream_id]
        self._update_usage()
        stream.writer.abort(stream.abort_code)
        if self._idle is not None and not self._streams and not self._idle.done():
            self._idle.set_result(None)


def _path(pseudo: Mapping[bytes, bytes]) -> str:
    return pseudo.get(b":path", b"").partition(b"?")[0].decode("latin-1")
