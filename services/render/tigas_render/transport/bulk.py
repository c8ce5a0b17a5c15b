"""A fast path for what a frame server does most: packets full of one stream's data.

aioquic's packet writer looks at every limit, every stream and every kind of frame for each packet. Here it still
writes everything but stream data; the data then follows in packets of one STREAM frame each, written straight
through. Together with `quic` and `h3` this is the one place that reaches into aioquic's private attributes.
"""

from __future__ import annotations

from typing import Any

from aioquic.quic.connection import QuicConnection, QuicNetworkPath
from aioquic.quic.packet import PACKET_FIXED_BIT, QuicFrameType, QuicPacketType
from aioquic.quic.packet_builder import PACKET_NUMBER_SEND_SIZE, QuicPacketBuilder, QuicSentPacket
from aioquic.quic.stream import QuicStream
from aioquic.tls import Epoch

from tigas_render.transport.pacing import TickPacer

SHORT_HEADER = 1 + PACKET_NUMBER_SEND_SIZE + 16
"""Bytes of a 1-RTT packet around its frames, without the connection id: first byte, packet number, AEAD tag."""
STREAM_TYPE = QuicFrameType.STREAM_BASE | 0x04
"""A STREAM frame with an offset that lasts to the end of its packet."""
FIN = 0x01


class BulkQuicConnection(QuicConnection):
    """A connection that writes stream data in bulk, the oldest stream first, so that frames arrive one by one."""

    def __init__(self, **arguments: Any) -> None:
        """Takes aioquic's arguments."""
        super().__init__(**arguments)
        self._loss._pacer = TickPacer(max_datagram_size=self._max_datagram_size)

    def _write_application(self, builder: QuicPacketBuilder, network_path: QuicNetworkPath, now: float) -> None:
        if not self._handshake_confirmed or not network_path.is_validated or self._probe_pending:
            super()._write_application(builder, network_path, now)
            return
        queue = self._streams_queue
        self._streams_queue = [
            stream
            for stream in queue
            if stream.is_finished or stream.receiver.stop_pending or stream.sender.reset_pending
        ]
        try:
            super()._write_application(builder, network_path, now)
        finally:
            self._streams_queue = [stream for stream in queue if stream.stream_id in self._streams]
        self._write_stream_data(builder, now)

    def _write_stream_data(self, builder: QuicPacketBuilder, now: float) -> None:
        sending = [stream for stream in self._streams_queue if not (stream.is_blocked or stream.sender.buffer_is_empty)]
        if not sending:
            return
        if builder._packet is not None:
            builder._end_packet()
        assert builder.max_flight_bytes is not None
        sending.sort(key=_stream_id)
        pacer = self._loss._pacer
        for stream in sending:
            while builder.max_flight_bytes - builder._flight_bytes >= self._max_datagram_size:
                self._pacing_at = pacer.next_send_time(now)
                if self._pacing_at is not None:
                    return
                if not self._write_stream_packet(builder, stream):
                    break
                pacer.update_after_send(now)

    def _write_stream_packet(self, builder: QuicPacketBuilder, stream: QuicStream) -> bool:
        """One packet with as much of a stream as it holds; whether there was anything to send."""
        sender = stream.sender
        position = _varint(_stream_id(stream)) + _varint(sender.next_offset)
        before = sender.highest_offset
        frame = sender.get_frame(
            self._max_datagram_size - SHORT_HEADER - len(self._peer_cid.cid) - 1 - len(position),
            min(before + self._remote_max_data - self._remote_max_data_used, stream.max_stream_data_remote),
        )
        if frame is None:
            return False
        self._remote_max_data_used += sender.highest_offset - before
        crypto = self._cryptos[Epoch.ONE_RTT]
        number = builder._packet_number
        first = PACKET_FIXED_BIT | self._spin_bit << 5 | crypto.key_phase << 2 | PACKET_NUMBER_SEND_SIZE - 1
        packet = crypto.encrypt_packet(
            b"%c%b%b" % (first, self._peer_cid.cid, (number & 0xFFFF).to_bytes(PACKET_NUMBER_SEND_SIZE, "big")),
            b"%c%b%b" % (STREAM_TYPE | FIN if frame.fin else STREAM_TYPE, position, frame.data),
            number,
        )
        builder._datagrams.append(packet)
        builder._packets.append(
            QuicSentPacket(
                epoch=Epoch.ONE_RTT,
                in_flight=True,
                is_ack_eliciting=True,
                is_crypto_packet=False,
                packet_number=number,
                packet_type=QuicPacketType.ONE_RTT,
                sent_bytes=len(packet),
                delivery_handlers=[
                    (sender.on_data_delivery, (frame.offset, frame.offset + len(frame.data), frame.fin))
                ],
            )
        )
        builder._packet_number = number + 1
        builder._flight_bytes += len(packet)
        builder._total_bytes += len(packet)
        return True


def _stream_id(stream: QuicStream) -> int:
    assert stream.stream_id is not None
    return stream.stream_id


def _varint(value: int) -> bytes:
    """QUIC's variable-length integer (RFC 9000, 16) in four or eight bytes."""
    if value < 1 << 30:
        return (value | 0x8000_0000).to_bytes(4, "big")
    return (value | 0xC000_0000_0000_0000).to_bytes(8, "big")
