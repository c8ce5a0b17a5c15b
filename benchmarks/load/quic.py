"""aioquic's client connection without what a hundred viewers on a few cores cannot pay: frames are counted, not kept.

Only what carries frames is short: 1-RTT packets of an established connection. All else is aioquic's own. Reaches into
aioquic's private attributes, as `tigas_render.transport.quic` does.
"""

from __future__ import annotations

import ssl
from typing import Any

from aioquic._crypto import CryptoError
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import END_STATES, QuicConnection, QuicReceiveContext
from aioquic.quic.events import StreamDataReceived
from aioquic.quic.packet import QuicStreamFrame, decode_packet_number
from aioquic.quic.packet_builder import QuicPacketBuilder
from aioquic.quic.recovery import QuicPacketSpace
from aioquic.quic.stream import QuicStream, QuicStreamReceiver
from aioquic.tls import Epoch

HEAD = 2048
"""Bytes of an answer that are kept: a FrameHeader, or HTTP's fields, and a Problem."""
ACK_EVERY = 10
"""Packets after which an acknowledgement does not wait any longer, as in Chromium."""
CONNECTION_WINDOW, STREAM_WINDOW = 15 << 20, 6 << 20
"""Bytes that the server may send ahead, as to Chromium."""


def configuration() -> QuicConfiguration:
    """A viewer's, who trusts every certificate."""
    return QuicConfiguration(
        alpn_protocols=H3_ALPN,
        max_datagram_frame_size=65536,
        server_name="localhost",
        verify_mode=ssl.CERT_NONE,
        max_data=CONNECTION_WINDOW,
        max_stream_data=STREAM_WINDOW,
    )


class Answer(QuicStreamReceiver):
    """Receives a stream, and keeps its beginning only: the one event comes with its last byte."""

    def __init__(self, stream_id: int) -> None:
        super().__init__(stream_id=stream_id, readable=True)
        self._head = bytearray(HEAD)

    @property
    def size(self) -> int:
        """Bytes of the answer, as far as they are known."""
        return self.highest_offset

    def handle_frame(self, frame: QuicStreamFrame) -> StreamDataReceived | None:
        """Take a part; the answer's beginning once nothing is missing."""
        start, stop = frame.offset, frame.offset + len(frame.data)
        if start < HEAD:
            self._head[start : min(stop, HEAD)] = frame.data[: HEAD - start]
        if frame.fin:
            self._final_size = stop
        self.highest_offset = max(self.highest_offset, stop)
        if self.is_finished:
            return None
        if start <= self._buffer_start:
            self._buffer_start = max(self._buffer_start, stop)
        elif stop > start:
            self._ranges.add(start, stop)
        while len(self._ranges) and self._ranges[0].start <= self._buffer_start:
            self._buffer_start = max(self._buffer_start, self._ranges.shift().stop)
        if self._buffer_start != self._final_size:
            return None
        self.is_finished = True
        head = bytes(self._head[: min(HEAD, self._final_size)])
        return StreamDataReceived(data=head, end_stream=True, stream_id=self._stream_id or 0)


class ViewerConnection(QuicConnection):
    """A viewer's connection."""

    def __init__(self) -> None:
        super().__init__(configuration=configuration())
        self._unacknowledged = 0

    def ask(self, stream_id: int, request: bytes) -> None:
        """Open a stream with a request that is whole; its answer comes as one event."""
        self.send_stream_data(stream_id, request, end_stream=True)
        self._streams[stream_id].receiver = Answer(stream_id)

    def received(self, stream_id: int) -> int:
        """Bytes that have come on a stream."""
        stream = self._streams.get(stream_id)
        return 0 if stream is None else stream.receiver.highest_offset

    def receive_datagram(self, data: bytes, addr: Any, now: float) -> None:
        """As aioquic's."""
        if data[0] & 0x80 or not self._handshake_confirmed or self._close_pending or self._state in END_STATES:
            super().receive_datagram(data, addr, now)
            return
        space, crypto = self._spaces[Epoch.ONE_RTT], self._cryptos[Epoch.ONE_RTT].recv
        assert crypto.hp is not None
        assert crypto.aead is not None
        try:
            header, number = crypto.hp.remove(data, 1 + len(self._host_cids[0].cid))
            if (header[0] & 4) >> 2 != crypto.key_phase:
                super().receive_datagram(data, addr, now)
                return
            number = decode_packet_number(number, 8 * ((header[0] & 3) + 1), space.expected_packet_number)
            plain = crypto.aead.decrypt(data[len(header) :], header, number)
        except CryptoError:
            return
        if number not in space.received_packets:
            self._take(space, number, plain, header, now)

    def _take(self, space: QuicPacketSpace, number: int, plain: bytes, header: bytes, now: float) -> None:
        context = QuicReceiveContext(
            epoch=Epoch.ONE_RTT,
            host_cid=header[1 : 1 + len(self._host_cids[0].cid)],
            network_path=self._network_paths[0],
            quic_logger_frames=None,
            time=now,
            version=None,
        )
        elicits, _ = self._payload_received(context, plain)
        if self._state in END_STATES:
            return
        self._close_at = now + self._idle_timeout()
        self._ack_eliciting_sent_since_receipt = False
        space.expected_packet_number = max(space.expected_packet_number, number + 1)
        if number > space.largest_received_packet:
            space.largest_received_packet, space.largest_received_time = number, now
        space.ack_queue.add(number)
        space.received_packets.add(number)
        if elicits:
            self._unacknowledged += 1
            if self._unacknowledged >= ACK_EVERY:
                space.ack_at = now
            elif space.ack_at is None:
                space.ack_at = now + self._ack_delay

    def _write_ack_frame(self, builder: QuicPacketBuilder, space: QuicPacketSpace, now: float) -> None:
        super()._write_ack_frame(builder, space, now)
        self._unacknowledged = 0

    def _write_stream_limits(self, builder: QuicPacketBuilder, space: QuicPacketSpace, stream: QuicStream) -> None:
        """No answer is longer than its first window."""


class ViewerH3Connection(H3Connection):
    """A viewer's HTTP/3 connection, without a dynamic table: answers are read without knowing those before them."""

    def _init_connection(self) -> None:
        self._max_table_capacity = self._blocked_streams = 0
        self._decoder = type(self._decoder)(0, 0)
        super()._init_connection()
