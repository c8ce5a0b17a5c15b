"""Where a connection's streams send: no faster than the network and the client take it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from functools import partial

from aioquic.buffer import encode_uint_var
from aioquic.h3.connection import FrameType
from aioquic.h3.events import Headers

from tigas_render.admission.limits import Limits
from tigas_render.transport.aioquic_ext.h3 import ServerH3Connection
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection

CHUNK = 64 * 1024
"""Bytes handed to QUIC at a time."""


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
        self.with_datagrams: list[Callable[[], bool]] = []
        """`Datagrams.hand_over` of the sessions with datagrams that wait."""
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
        self.with_datagrams = [hand_over for hand_over in self.with_datagrams if hand_over()]
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
        if not data:
            return
        sent = asyncio.get_running_loop().create_future()
        header = encode_uint_var(FrameType.DATA) + encode_uint_var(len(data))
        sending = _Sending(self._writer, self, (header, data), partial(_resolve, sent))
        sending.go_on()
        try:
            await sent
        finally:
            sending.stop_waiting()
        if sending.parts:
            raise StreamClosed

    def finish(self, parts: Sequence[bytes | memoryview], ended: Callable[[], None]) -> None:
        """Send bytes and end the stream; then call `ended`, also on failure.

        The parts need not be kept: data that the network or the client cannot take yet is copied.
        """
        _Sending(self._writer, self, parts, ended, ends_stream=True).go_on()

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


class _Sending:
    """Bytes on their way to QUIC."""

    def __init__(
        self,
        writer: Writer,
        outlet: Outlet,
        parts: Sequence[bytes | memoryview],
        ended: Callable[[], None],
        *,
        ends_stream: bool = False,
    ) -> None:
        """ended: called at the end of all work. ends_stream: whether nothing follows; then the caller does not keep the
        parts.
        """
        self.parts = list(parts)
        """Not handed over yet."""
        self._writer = writer
        self._outlet = outlet
        self._ended = ended
        self._ends_stream = ends_stream
        self._stalled: asyncio.TimerHandle | None = None

    def go_on(self) -> None:
        """Hand over as much as fits, and wait for room for the rest."""
        self.stop_waiting()
        writer, outlet = self._writer, self._outlet
        while self.parts and not writer.closed and outlet.is_open:
            room = writer.room(outlet.stream_id)
            if not room:
                self._wait()
                return
            while self.parts and room:
                room -= self._write(room)
        if self._ends_stream and not self.parts and not writer.closed:
            outlet.end()
        self._ended()

    def stop_waiting(self) -> None:
        """Do not go on by itself any more."""
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None
            del self._writer.waiting[self._outlet.stream_id]

    def _write(self, room: int) -> int:
        part = self.parts[0]
        if len(part) <= room:
            del self.parts[0]
        else:
            self.parts[0], part = part[room:], part[:room]
        self._writer.quic.send_stream_data(self._outlet.stream_id, part)  # type: ignore[arg-type]  # any buffer
        self._writer.transmit_soon()
        return len(part)

    def _wait(self) -> None:
        if self._ends_stream:
            self.parts = [bytes(part) for part in self.parts]
        self._writer.waiting[self._outlet.stream_id] = self.go_on
        self._stalled = asyncio.get_running_loop().call_later(self._outlet.limits.stall_timeout, self._give_up)

    def _give_up(self) -> None:
        """The client does not read."""
        self.stop_waiting()
        self._ended()


def _resolve(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
