"""A viewer's connection to the render service: WebTransport, or POST over HTTP/3."""

from __future__ import annotations

import asyncio
import json
import math
import struct
import time
from typing import Any, Protocol

import pylsqpack
from aioquic._buffer import Buffer, BufferReadError
from aioquic.h3.connection import FrameType, encode_frame
from aioquic.h3.events import HeadersReceived
from aioquic.quic.events import ConnectionTerminated, HandshakeCompleted, StreamDataReceived, StreamReset

from benchmarks.load.quic import ViewerConnection, ViewerH3Connection
from benchmarks.load.udp import ViewerSocket

WEBTRANSPORT_CANCELLED = 0x52E4A40FA8DB
"""WebTransport's application error 0 as an HTTP/3 error code."""
REQUEST_CANCELLED = 0x010C
WEBTRANSPORT_STREAM = b"\x40\x41"
"""First bytes of a session's bidirectional stream, before the session's id."""


class Listener(Protocol):
    """Callbacks of a connection."""

    def opened(self) -> None:
        """Frames may be asked for."""

    def answered(self, stream_id: int, status: int, header: dict[str, Any], size: int, arrived: float) -> None:
        """An answer is there, whole. header: the FrameHeader; with POST, only its rate. size: bytes."""

    def failed(self, stream_id: int) -> None:
        """The service has reset a stream."""

    def closed(self, retry_after_s: float | None) -> None:
        """The connection is over, or was never made; the service may have said when to try again."""


class Client:
    """One connection, for as long as it lasts."""

    def __init__(self, server: tuple[str, int], source: str | None, posts: bool, listener: Listener) -> None:
        """source: the address to come from, or None. posts: whether frames are asked for by POST. Raises OSError."""
        self._listener = listener
        self._posts = posts
        self._loop = asyncio.get_running_loop()
        self._socket = ViewerSocket(server, source)
        self._quic = ViewerConnection()
        self._h3: ViewerH3Connection | None = None
        self._session: int | None = None
        self._head = b""
        """First bytes of each request."""
        self._is_open = self._is_over = False
        self._timer: asyncio.TimerHandle | None = None
        self._timer_at = math.inf
        authority = f"{server[0]}:{server[1]}".encode()
        self._fields = ((b":scheme", b"https"), (b":authority", authority), (b":path", b"/render"))
        self._loop.add_reader(self._socket.fileno(), self._readable)
        self._quic.connect(self._socket.server, time.monotonic())
        self._transmit()

    @property
    def dropped(self) -> int:
        """Datagrams that came and were not read in time."""
        return self._socket.dropped

    def ask(self, request: bytes) -> int:
        """Ask for a frame; the stream's id."""
        stream_id = self._quic.get_next_available_stream_id()
        self._quic.ask(stream_id, self._head + (encode_frame(FrameType.DATA, request) if self._posts else request))
        self._transmit()
        return stream_id

    def cancel(self, stream_id: int) -> None:
        """Want no answer any more."""
        self._quic.stop_stream(stream_id, REQUEST_CANCELLED if self._posts else WEBTRANSPORT_CANCELLED)
        self._transmit()

    def close(self) -> None:
        """Leave, without a word to the listener."""
        if not self._is_over:
            self._quic.close()
            self._transmit()
            self._end()

    def _end(self) -> None:
        self._is_over = True
        self._loop.remove_reader(self._socket.fileno())
        if self._timer is not None:
            self._timer.cancel()
        self._socket.close()

    # -- network -----------------------------------------------------------------------------------------------------

    def _readable(self) -> None:
        try:
            for data, arrived in self._socket.read():
                self._quic.receive_datagram(data, self._socket.server, time.monotonic())
                self._handle_events(arrived)
                if self._is_over:  # the socket is closed, too
                    return
        except ConnectionError:
            self._lost(None)
        if self._quic.is_over:
            self._lost(None)
        self._transmit()

    def _transmit(self) -> None:
        if self._is_over:
            return
        now = time.monotonic()
        try:
            if (acknowledgement := self._quic.acknowledgement(now)) is not None:
                self._socket.send(acknowledgement)
            for data, _ in self._quic.datagrams_to_send(now):
                self._socket.send(data)
        except ConnectionError:
            self._lost(None)
            return
        self._set_timer(now)

    def _set_timer(self, now: float) -> None:
        due = self._quic.get_timer()
        if due is None or due >= self._timer_at:  # an earlier one sees then that it is not due
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer_at = due
        self._timer = self._loop.call_later(max(0.0, due - now), self._timed_out)

    def _timed_out(self) -> None:
        self._timer, self._timer_at = None, math.inf
        now = time.monotonic()
        due = self._quic.get_timer()
        if due is None or due > now:
            self._set_timer(now)
            return
        self._quic.handle_timer(now)
        self._handle_events(now)
        self._transmit()

    def _lost(self, retry_after_s: float | None) -> None:
        if not self._is_over:
            self._end()
            self._listener.closed(retry_after_s)

    # -- events ------------------------------------------------------------------------------------------------------

    def _handle_events(self, arrived: float) -> None:
        while not self._is_over and (event := self._quic.next_event()) is not None:
            match event:
                case StreamDataReceived() if self._is_open and event.stream_id % 4 == 0:
                    if event.stream_id != self._session:
                        self._answered(event.stream_id, event.data, arrived)
                    elif event.end_stream:
                        self._lost(None)
                case StreamReset():
                    if event.stream_id == self._session:
                        self._lost(None)
                    else:
                        self._listener.failed(event.stream_id)
                case HandshakeCompleted():
                    self._begin()
                case ConnectionTerminated():
                    self._lost(None)
                case _ if self._h3 is not None:
                    for h3_event in self._h3.handle_event(event):
                        if isinstance(h3_event, HeadersReceived) and h3_event.stream_id == self._session:
                            self._session_answered(dict(h3_event.headers))

    def _begin(self) -> None:
        self._h3 = ViewerH3Connection(self._quic, enable_webtransport=True)
        if self._posts:
            fields = [(b":method", b"POST"), *self._fields, (b"content-type", b"application/json")]
            # no table to refer to: the same bytes on every stream
            self._head = encode_frame(FrameType.HEADERS, pylsqpack.Encoder().encode(0, fields)[1])
            self._is_open = True
            self._listener.opened()
            return
        self._session = self._quic.get_next_available_stream_id()
        self._h3.send_headers(self._session, [(b":method", b"CONNECT"), (b":protocol", b"webtransport"), *self._fields])

    def _session_answered(self, fields: dict[bytes, bytes]) -> None:
        if fields[b":status"] != b"200":
            self._quic.close()
            self._transmit()
            self._lost(float(fields.get(b"retry-after", b"nan")))
            return
        assert self._session is not None
        self._head = WEBTRANSPORT_STREAM + _varint(self._session)
        self._is_open = True
        self._listener.opened()

    def _answered(self, stream_id: int, head: bytes, arrived: float) -> None:
        try:
            status, header = _post_status(head) if self._posts else _frame_header(head)
        except (ValueError, KeyError, IndexError, struct.error, BufferReadError, pylsqpack.DecompressionFailed):
            status, header = 0, {}
        self._listener.answered(stream_id, status, header, self._quic.received(stream_id), arrived)


def _frame_header(head: bytes) -> tuple[int, dict[str, Any]]:
    (length,) = struct.unpack_from("!I", head)
    header: dict[str, Any] = json.loads(head[4 : 4 + length])
    return int(header["status"]), header


def _post_status(head: bytes) -> tuple[int, dict[str, Any]]:
    buffer = Buffer(data=head)
    if buffer.pull_uint_var() != FrameType.HEADERS:
        raise ValueError("an answer that does not begin with its fields")
    section = buffer.pull_bytes(buffer.pull_uint_var())
    _, fields = pylsqpack.Decoder(0, 0).feed_header(0, section)
    named = dict(fields)
    about = dict(part.split(b"=") for part in named.get(b"tigas-frame", b"").split(b", ") if part)
    rate = about.get(b"requests_per_s")
    return int(named[b":status"]), {} if rate is None else {"requests_per_s": float(rate)}


def _varint(value: int) -> bytes:
    buffer = Buffer(capacity=8)
    buffer.push_uint_var(value)
    return buffer.data
