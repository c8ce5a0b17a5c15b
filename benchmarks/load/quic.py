"""aioquic's client connection, made cheap enough for a hundred viewers on a few cores.

Two things have a short path: packets with only the end of an answer's stream, counted and not kept, and packets with
only an acknowledgement. Everything else is aioquic's own. It uses aioquic's private attributes, like
`tigas_render.transport.aioquic_ext.quic`.
"""

from __future__ import annotations

import ssl
from typing import Any

from aioquic._buffer import Buffer
from aioquic._crypto import CryptoError
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import END_STATES, QuicConnection, QuicReceiveContext
from aioquic.quic.events import StreamDataReceived
from aioquic.quic.packet import (
    PACKET_FIXED_BIT,
    QuicFrameType,
    QuicStreamFrame,
    decode_packet_number,
    push_ack_frame,
)
from aioquic.quic.packet_builder import PACKET_NUMBER_SEND_SIZE, QuicPacketBuilder
from aioquic.quic.recovery import QuicPacketSpace
from aioquic.quic.stream import QuicStream, QuicStreamReceiver
from aioquic.tls import Epoch

HEAD = 2048
"""Bytes of an answer that are kept: a FrameHeader, or HTTP's fields, and a Problem."""
ACK_EVERY = 10
"""Packets after which an acknowledgement does not wait any longer, as in Chromium."""
CONNECTION_WINDOW, STREAM_WINDOW = 15 << 20, 6 << 20
"""Bytes that the server may send ahead, as to Chromium."""
STREAM_TO_THE_END = QuicFrameType.STREAM_BASE | 0x04
"""A STREAM frame with an offset that lasts to the end of its packet; with FIN, one more."""
MAX_ACK_BYTES = 64


def configuration() -> QuicConfiguration:
    """A viewer's configuration, which trusts every certificate."""
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
        self._parts: list[tuple[int, bytes]] = []
        """Of the beginning, if they came out of order."""

    def take(self, start: int, data: bytes, fin: bool) -> StreamDataReceived | None:
        """Take a part; the answer's beginning once nothing is missing."""
        stop = start + len(data)
        if start < HEAD:
            self._parts.append((start, data[: HEAD - start]))
        if fin:
            self._final_size = stop
        if stop > self.highest_offset:
            self.highest_offset = stop
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
        head = bytearray(min(HEAD, self._final_size))
        for at, part in self._parts:
            head[at : at + len(part)] = part
        return StreamDataReceived(data=bytes(head), end_stream=True, stream_id=self._stream_id or 0)

    def handle_frame(self, frame: QuicStreamFrame) -> StreamDataReceived | None:
        """As `take`."""
        return self.take(frame.offset, frame.data, frame.fin)


class ViewerConnection(QuicConnection):
    """A viewer's connection."""

    def __init__(self) -> None:
        super().__init__(configuration=configuration())
        self._unacknowledged = 0
        self._was_reset = False

    @property
    def is_over(self) -> bool:
        """Whether the server has closed it, or knows nothing of it any more (RFC 9000, 10.3)."""
        return self._was_reset or self._state in END_STATES

    def ask(self, stream_id: int, request: bytes) -> None:
        """Open a stream with a request that is whole; its answer comes as one event."""
        self.send_stream_data(stream_id, request, end_stream=True)
        self._streams[stream_id].receiver = Answer(stream_id)

    def received(self, stream_id: int) -> int:
        """Bytes that have come on a stream."""
        stream = self._streams.get(stream_id)
        return 0 if stream is None else stream.receiver.highest_offset

    # -- receiving ---------------------------------------------------------------------------------------------------

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
            if (header[0] & 4) >> 2 != crypto.key_phase and not self._is_reset(data):
                super().receive_datagram(data, addr, now)
                return
            number = decode_packet_number(number, 8 * ((header[0] & 3) + 1), space.expected_packet_number)
            plain = crypto.aead.decrypt(data[len(header) :], header, number)
        except CryptoError:
            self._was_reset |= self._is_reset(data)
            return
        if number in space.received_packets:
            return
        elicits = self._take_answer(plain) or self._take_any(plain, header, now)
        if self._state in END_STATES:
            return
        if number > space.largest_received_packet:
            space.largest_received_packet, space.largest_received_time = number, now
            space.expected_packet_number = number + 1
        space.ack_queue.add(number)
        space.received_packets.add(number)
        if elicits:
            self._unacknowledged += 1
            if self._unacknowledged >= ACK_EVERY:
                space.ack_at = now
            elif space.ack_at is None:
                space.ack_at = now + self._ack_delay

    def _is_reset(self, data: bytes) -> bool:
        return data[-16:] == self._peer_cid.stateless_reset_token

    def _take_answer(self, plain: bytes) -> bool:
        """Take a packet that is all one answer's; False if it is another."""
        if plain[0] & 0xFE != STREAM_TO_THE_END:
            return False
        stream_id, at = _varint(plain, 1)
        offset, at = _varint(plain, at)
        stream = self._streams.get(stream_id)
        if stream is None or type(stream.receiver) is not Answer:
            return False
        answer = stream.receiver
        before = answer.highest_offset
        event = answer.take(offset, plain[at:], bool(plain[0] & 1))
        self._local_max_data.used += answer.highest_offset - before
        if event is not None:
            self._events.append(event)
        return True

    def _take_any(self, plain: bytes, header: bytes, now: float) -> bool:
        context = QuicReceiveContext(
            epoch=Epoch.ONE_RTT,
            host_cid=header[1 : 1 + len(self._host_cids[0].cid)],
            network_path=self._network_paths[0],
            quic_logger_frames=None,
            time=now,
            version=None,
        )
        elicits, _ = self._payload_received(context, plain)
        if self._state not in END_STATES:
            self._close_at = now + self._idle_timeout()
            self._ack_eliciting_sent_since_receipt = False
        return elicits

    # -- sending -----------------------------------------------------------------------------------------------------

    def acknowledgement(self, now: float) -> bytes | None:
        """A packet with nothing but an acknowledgement, if one is due; it is lost without harm."""
        space, crypto = self._spaces[Epoch.ONE_RTT], self._cryptos[Epoch.ONE_RTT]
        due = space.ack_at is not None and space.ack_at <= now
        if not (due and self._handshake_confirmed and len(space.ack_queue) == 1) or self._state in END_STATES:
            return None
        assert space.largest_received_time is not None
        frame = Buffer(capacity=MAX_ACK_BYTES)
        frame.push_uint_var(QuicFrameType.ACK)
        delay = int((now - space.largest_received_time) * 1_000_000) >> self._local_ack_delay_exponent
        push_ack_frame(frame, space.ack_queue, delay, MAX_ACK_BYTES)
        space.ack_at, self._unacknowledged = None, 0
        number, self._packet_number = self._packet_number, self._packet_number + 1
        first = PACKET_FIXED_BIT | self._spin_bit << 5 | crypto.key_phase << 2 | PACKET_NUMBER_SEND_SIZE - 1
        short = (number & 0xFFFF).to_bytes(PACKET_NUMBER_SEND_SIZE, "big")
        return crypto.encrypt_packet(b"%c%b%b" % (first, self._peer_cid.cid, short), frame.data, number)

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


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """QUIC's variable-length integer (RFC 9000, 16), and where it ends."""
    size = 1 << (data[at] >> 6)
    return int.from_bytes(data[at : at + size], "big") & ((1 << (8 * size - 2)) - 1), at + size
