"""Where a connection's streams and sessions send: no faster than the network and the client take it."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import partial

from aioquic.buffer import encode_uint_var
from aioquic.h3.events import Headers

from tigas_render.admission.limits import Limits
from tigas_render.transport.aioquic_ext.h3 import ServerH3Connection
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection

CHUNK = 64 * 1024
"""Bytes handed to QUIC at a time."""
MAX_URGENT = 64
"""Datagrams of one session that may wait ahead of others."""
SESSION_ID_BYTES = 8
"""The most that the session's id takes of a datagram."""


class StreamClosed(ConnectionError):
    """The client has cancelled the stream or disconnected."""


class Writer:
    """State shared by all outlets of one connection."""

    def __init__(
        self,
        quic: ServerQuicConnection,
        h3: ServerH3Connection,
        limits: Limits,
        transmit_soon: Callable[[], None],
    ) -> None:
        self.quic = quic
        self.h3 = h3
        self.limits = limits
        self.transmit_soon = transmit_soon
        self.waiting: dict[int, Callable[[], None]] = {}
        """Callbacks of writers that wait for room, by stream."""
        self.with_datagrams: list[DatagramOutlet] = []
        """Sessions with datagrams that wait."""
        self.closed = False

    def room(self, stream_id: int) -> int:
        """Bytes that a stream may hand to QUIC now: none, or at least a chunk."""
        network, total = self.quic.unsent_total()
        used = max(self.quic.unsent(stream_id), network)
        room = min(self.limits.unsent - used, self.limits.unread_answers - total)
        return max(room, CHUNK) if room > 0 else 0

    def wake(self) -> None:
        """Resume writers with room, oldest stream first."""
        for stream_id in sorted(self.waiting):
            if not self.quic.can_write(stream_id) or self.room(stream_id):
                self.waiting[stream_id]()

    def hand_over_datagrams(self) -> bool:
        """Give QUIC as many datagrams as it can send soon; whether any are left."""
        self.with_datagrams = [outlet for outlet in self.with_datagrams if outlet.hand_over()]
        return bool(self.with_datagrams)

    def close(self) -> None:
        """Resume all writers, which then find the connection closed."""
        self.closed = True
        for go_on in list(self.waiting.values()):
            go_on()


class Outlet:
    """The server's side of one stream. Writes to an ended stream are dropped."""

    def __init__(self, writer: Writer, stream_id: int) -> None:
        self.stream_id = stream_id
        self.limits = writer.limits
        self._writer = writer

    @property
    def is_open(self) -> bool:
        """Whether the server's side is neither finished nor reset."""
        return self._writer.quic.can_write(self.stream_id)

    def send_headers(self, headers: Headers) -> None:
        """Send an HTTP header section."""
        if self.is_open:
            self._writer.h3.send_headers(self.stream_id, headers)
            self._writer.transmit_soon()

    async def send_data(self, data: memoryview) -> None:
        """Send a part of an HTTP body; waits while the network or the client cannot keep up.

        data: must not change until then. Raises StreamClosed if the client has cancelled, disconnected, or not read for
        too long.
        """
        start = 0
        while start < len(data):
            stop = start + await self._room()
            self._writer.h3.send_body(self.stream_id, data[start:stop])
            self._writer.transmit_soon()
            start = stop

    def finish(self, parts: Sequence[bytes | memoryview], ended: Callable[[], None]) -> None:
        """Send bytes and end the stream; then call `ended`, also on failure.

        The parts need not be kept: data that the network or the client cannot take yet is copied.
        """
        Answer(self._writer, self, parts, ended).go_on()

    def end(self) -> None:
        """End the server's side."""
        if self.is_open:
            self._writer.quic.send_stream_data(self.stream_id, b"", end_stream=True)
            self._writer.h3.finished(self.stream_id)
            self._writer.transmit_soon()

    def stop_reading(self, error_code: int) -> None:
        """Ask the client to send no more."""
        if self._writer.quic.is_receiving(self.stream_id):
            self._writer.quic.stop_stream(self.stream_id, error_code)
            self._writer.transmit_soon()

    def abort(self, error_code: int) -> None:
        """End both directions, unless ended already."""
        self.stop_reading(error_code)
        if self.is_open:
            self._writer.quic.reset_stream(self.stream_id, error_code)
            self._writer.transmit_soon()
        self._writer.h3.finished(self.stream_id)

    async def _room(self) -> int:
        writer = self._writer
        while not writer.closed and self.is_open:
            if room := writer.room(self.stream_id):
                return room
            waiter = asyncio.get_running_loop().create_future()
            writer.waiting[self.stream_id] = partial(_resolve, waiter)
            try:
                async with asyncio.timeout(self.limits.stall_timeout):
                    await waiter
            except TimeoutError:
                raise StreamClosed("the client reads nothing") from None
            finally:
                del writer.waiting[self.stream_id]
        raise StreamClosed("the stream is closed")


class Answer:
    """All that is sent on a stream, on its way to QUIC."""

    def __init__(
        self,
        writer: Writer,
        outlet: Outlet,
        parts: Sequence[bytes | memoryview],
        ended: Callable[[], None],
    ) -> None:
        """ended: called at the end of all work."""
        self._writer = writer
        self._outlet = outlet
        self._parts = list(parts)
        self._ended = ended
        self._stalled: asyncio.TimerHandle | None = None

    def go_on(self) -> None:
        """Hand over as much as fits, and wait for room for the rest."""
        writer, stream_id = self._writer, self._outlet.stream_id
        if self._stalled is not None:
            self._stalled.cancel()
            del writer.waiting[stream_id]
        while self._parts and not writer.closed and self._outlet.is_open:
            room = writer.room(stream_id)
            if not room:
                self._wait()
                return
            self._write(room)
        if not self._parts and not writer.closed:
            self._outlet.end()
        self._ended()

    def _write(self, room: int) -> None:
        part = self._parts[0]
        if len(part) <= room:
            del self._parts[0]
        else:
            self._parts[0] = part[room:]
        self._writer.quic.send_stream_data(self._outlet.stream_id, part[:room])  # type: ignore[arg-type]  # any buffer
        self._writer.transmit_soon()

    def _wait(self) -> None:
        self._parts = [bytes(part) for part in self._parts]
        self._writer.waiting[self._outlet.stream_id] = self.go_on
        self._stalled = asyncio.get_running_loop().call_later(self._outlet.limits.stall_timeout, self._give_up)

    def _give_up(self) -> None:
        """The client does not read."""
        del self._writer.waiting[self._outlet.stream_id]
        self._ended()


def _resolve(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)


class DatagramOutlet:
    """A WebTransport session's datagrams. They wait here, where they can be taken back, until the network has room."""

    def __init__(self, writer: Writer, session_id: int) -> None:
        """session_id: the id of the stream that opened the session."""
        self._writer = writer
        self._prefix = encode_uint_var(session_id // 4)  # RFC 9297, 2.1
        self._waiting: deque[bytes] = deque()
        self._urgent: deque[bytes] = deque(maxlen=MAX_URGENT)

    @property
    def max_size(self) -> int:
        """The longest datagram that fits in a packet now, in bytes; it may shrink with the path."""
        return self._writer.quic.max_datagram_payload - SESSION_ID_BYTES

    def replace(self, datagrams: Iterable[bytes]) -> None:
        """Send these instead of the waiting ones."""
        self._waiting = deque(datagrams)
        self._send_soon()

    def send_first(self, datagrams: Iterable[bytes]) -> None:
        """Send these ahead of the waiting ones. Beyond the limit, the oldest are dropped."""
        self._urgent.extend(datagrams)
        self._send_soon()

    def hand_over(self) -> bool:
        """As `Writer.hand_over_datagrams`. A datagram that has become too long for the path is dropped."""
        quic = self._writer.quic
        for queue in (self._urgent, self._waiting):
            while queue and quic.datagram_room:
                data = self._prefix + queue.popleft()
                if len(data) <= quic.max_datagram_payload:
                    quic.send_datagram_frame(data)
        return bool(self._urgent or self._waiting)

    def close(self) -> None:
        """Drop the waiting ones."""
        self._waiting.clear()
        self._urgent.clear()

    def _send_soon(self) -> None:
        if self not in self._writer.with_datagrams:
            self._writer.with_datagrams.append(self)
        self._writer.transmit_soon()
