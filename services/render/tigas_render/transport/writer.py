"""What a connection sends: on streams, with back-pressure, and as datagrams."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable

from aioquic.h3.events import Headers

from tigas_render.transport.limits import Limits
from tigas_render.transport.quic import ServerH3Connection, ServerQuicConnection
from tigas_render.transport.stream import StreamClosed
from tigas_render.transport.webtransport import WebTransportSession


class Writer:
    """Hands data to QUIC no faster than it leaves. Whatever is for a stream that has ended goes nowhere."""

    def __init__(self, quic: ServerQuicConnection, limits: Limits, transmit_soon: Callable[[], None]) -> None:
        self.h3: ServerH3Connection | None = None
        """Known once the handshake has begun."""
        self._quic = quic
        self._limits = limits
        self._transmit_soon = transmit_soon
        self._waiting: dict[int, asyncio.Future[None]] = {}
        self._closed = False

    def close(self) -> None:
        """Wake everybody who waits, to be told that the connection is over."""
        self._closed = True
        for waiter in self._waiting.values():
            if not waiter.done():
                waiter.set_result(None)

    # -- streams -----------------------------------------------------------------------------------------------------

    def is_open(self, stream_id: int) -> bool:
        """Whether the server's side of a stream is neither finished nor reset."""
        return self._quic.can_write(stream_id)

    def headers(self, stream_id: int, headers: Headers, end: bool = False) -> None:
        """Send an HTTP header section."""
        if self.h3 is not None and self.is_open(stream_id):
            self.h3.send_headers(stream_id, headers, end)
            self._transmit_soon()

    def data(self, stream_id: int, data: bytes, end: bool) -> None:
        """Send a part of an HTTP body."""
        if self.h3 is not None and self.is_open(stream_id):
            self.h3.send_data(stream_id, data, end)
            self._transmit_soon()

    def raw(self, stream_id: int, data: bytes, end: bool) -> None:
        """Send bytes of a stream as they are."""
        if self.h3 is not None and self.is_open(stream_id):
            self._quic.send_stream_data(stream_id, data, end)
            if end:
                self.h3.finished(stream_id)
            self._transmit_soon()

    def abort(self, stream_id: int, error_code: int) -> None:
        """End whatever is not ended yet, in both directions."""
        if self._quic.is_receiving(stream_id):
            self._quic.stop_stream(stream_id, error_code)
        if self.is_open(stream_id):
            self._quic.reset_stream(stream_id, error_code)
        if self.h3 is not None:
            self.h3.finished(stream_id)
        self._transmit_soon()

    def stop_reading(self, stream_id: int, error_code: int) -> None:
        """Ask the client to send no more on a stream."""
        if self._quic.is_receiving(stream_id):
            self._quic.stop_stream(stream_id, error_code)
            self._transmit_soon()

    # -- back-pressure -----------------------------------------------------------------------------------------------

    async def room(self, stream_id: int) -> None:
        """Wait until a stream may hand more data to QUIC; the oldest stream of a connection goes first.

        Raises StreamClosed if the client cancelled, is gone, or has read nothing for too long.
        """
        while not self._closed and self.is_open(stream_id):
            if self._has_room(stream_id):
                return
            waiter = self._waiting[stream_id] = asyncio.get_running_loop().create_future()
            try:
                async with asyncio.timeout(self._limits.stall_timeout):
                    await waiter
            except TimeoutError:
                raise StreamClosed("the client reads nothing") from None
            finally:
                del self._waiting[stream_id]
        raise StreamClosed("the stream is closed")

    def wake(self) -> None:
        """Let those write on for whom there is room now."""
        for stream_id in sorted(self._waiting):
            waiter = self._waiting[stream_id]
            if not waiter.done() and (not self.is_open(stream_id) or self._has_room(stream_id)):
                waiter.set_result(None)

    def _has_room(self, stream_id: int) -> bool:
        limits = self._limits
        network, total = self._quic.unsent_total()
        return (
            self._quic.unsent(stream_id) < limits.unsent and network < limits.unsent and total < limits.unread_answers
        )

    # -- datagrams ---------------------------------------------------------------------------------------------------

    @property
    def max_datagram(self) -> int:
        """The longest WebTransport datagram that can be sent, in bytes; the session's id takes up to 8 more."""
        return self._quic.max_datagram_payload - 8

    def hand_over_datagrams(self, sessions: Iterable[WebTransportSession]) -> bool:
        """Give QUIC as many datagrams as it can send soon; whether any are left."""
        more = False
        for session in sessions:
            for queue in (session.urgent, session.outgoing):
                while queue and self._quic.datagram_room:
                    data = session.prefix + queue.popleft()
                    if len(data) <= self._quic.max_datagram_payload:
                        self._quic.send_datagram_frame(data)
                more |= bool(queue)
        return more
