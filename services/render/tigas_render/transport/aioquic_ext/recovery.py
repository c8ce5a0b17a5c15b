"""aioquic's loss recovery, extended to handle batches of stream packets when they are sent and acknowledged."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from aioquic.quic.packet import QuicPacketType
from aioquic.quic.packet_builder import QuicDeliveryHandler, QuicDeliveryState, QuicSentPacket
from aioquic.quic.rangeset import RangeSet
from aioquic.quic.recovery import QuicPacketRecovery, QuicPacketSpace
from aioquic.quic.stream import QuicStreamSender
from aioquic.tls import Epoch

from tigas_render.transport.aioquic_ext.congestion import LimitedReno

Handlers = Sequence[tuple[QuicDeliveryHandler, Any]]


@dataclass(slots=True, eq=False)
class StreamPacket:
    """A packet in flight with one stream's data. A lighter equivalent of aioquic's QuicSentPacket."""

    epoch: ClassVar = Epoch.ONE_RTT
    in_flight: ClassVar = True
    is_ack_eliciting: ClassVar = True
    is_crypto_packet: ClassVar = False
    packet_type: ClassVar = QuicPacketType.ONE_RTT

    packet_number: int
    sent_time: float
    sent_bytes: int
    sender: QuicStreamSender
    start: int
    """Offset of the first byte in the stream; `stop` is the end."""
    stop: int
    fin: bool
    others: Handlers = ()
    """Delivery handlers of the packet's other frames."""

    @property
    def delivery_handlers(self) -> Handlers:
        return (*self.others, (on_chunk_delivery, (self.sender, self.start, self.stop, self.fin)))

    @property
    def is_outstanding(self) -> bool:
        """Whether its data has been neither acknowledged, nor declared lost, nor withdrawn by a reset."""
        sender = self.sender
        return (
            sender._reset_error_code is None
            and self.start >= sender._buffer_start
            and not any(each.start <= self.start < each.stop for each in (*sender._acked, *sender._pending))
        )


class CopyPacket(StreamPacket):
    """A second copy of a stream packet's data."""

    __slots__ = ()
    in_flight: ClassVar = False


def on_chunk_delivery(delivery: QuicDeliveryState, sender: QuicStreamSender, start: int, stop: int, fin: bool) -> None:
    """Notify a stream that a part of it was acknowledged or lost, where the part may have been sent twice.

    aioquic's sender expects one acknowledgement per byte, and resends lost bytes even if their copy has arrived.
    """
    fin = fin and not sender._acked_fin
    start = max(start, sender._buffer_start)
    if delivery == QuicDeliveryState.ACKED:
        if start < stop and len(sender._pending):
            sender._pending.subtract(start, stop)
        sender._pending_eof &= not fin
        sender.on_data_delivery(delivery, start, max(start, stop), fin)
        return
    missing = RangeSet([range(start, stop)] if stop > start else [])
    for each in sender._acked:
        missing.subtract(each.start, each.stop)
    for each in missing:
        sender.on_data_delivery(delivery, each.start, each.stop, False)
    if fin:
        sender.on_data_delivery(delivery, stop, stop, fin)


SentPacket = QuicSentPacket | StreamPacket
"""aioquic's code works with both, but its annotations mention only the first."""


class BatchRecovery(QuicPacketRecovery):
    """Loss recovery with a batch-aware congestion controller, LimitedReno or a subclass."""

    _cc: LimitedReno

    def set_datagram_size(self, size: int) -> None:
        """Set the datagram size in bytes, for the window and the pacer."""
        self._cc.set_datagram_size(size)
        self._pacer._max_datagram_size = size
        if self._pacer.packet_time is not None:
            self._pacer.update_rate(self._cc.congestion_window, self._rtt_smoothed)

    def should_duplicate(self, now: float) -> bool:
        """Whether data is worth sending twice."""
        return self._cc.should_duplicate(now)

    def on_copies_sent(self, packets: Sequence[CopyPacket], space: QuicPacketSpace) -> None:
        """Record second copies, which elicit acknowledgements but say nothing about congestion."""
        space.sent_packets.update((packet.packet_number, packet) for packet in packets)  # type: ignore[misc]
        space.ack_eliciting_in_flight += len(packets)

    def reset_path_state(self, now: float) -> None:
        """Reset the congestion window and the round trip, as on a new path."""
        self._cc = self._cc.restarted_copy(now)
        self._pacer.packet_time = None
        self._rtt_initialized, self._rtt_min = False, math.inf
        self._pto_count = 0

    def on_stream_packets_sent(self, packets: Sequence[StreamPacket], space: QuicPacketSpace) -> None:
        """Like `on_packet_sent` for each packet, after the handshake is confirmed."""
        space.sent_packets.update((packet.packet_number, packet) for packet in packets)  # type: ignore[misc]
        space.ack_eliciting_in_flight += len(packets)
        self._time_of_last_sent_ack_eliciting_packet = packets[-1].sent_time
        self._cc.on_packets_sent(packets)  # type: ignore[arg-type]

    def on_other_packet_sent(
        self, number: int, now: float, size: int, handlers: Handlers, space: QuicPacketSpace, *, is_ack_eliciting: bool
    ) -> None:
        """Like `on_packet_sent`, for a packet without stream data. Only ack-eliciting packets count as in flight."""
        packet = QuicSentPacket(
            epoch=Epoch.ONE_RTT,
            in_flight=is_ack_eliciting,
            is_ack_eliciting=is_ack_eliciting,
            is_crypto_packet=False,
            packet_number=number,
            packet_type=QuicPacketType.ONE_RTT,
            sent_time=now,
            sent_bytes=size,
            delivery_handlers=list(handlers),
        )
        self.on_packet_sent(packet=packet, space=space)

    def on_ack_received(self, *, ack_rangeset: RangeSet, ack_delay: float, now: float, space: QuicPacketSpace) -> None:
        """Handle acknowledged packets in a batch, and leave only the newest to aioquic, for the round trip."""
        acked = _acked_packets(space, ack_rangeset)
        while acked and not acked.pop().is_ack_eliciting:
            pass
        if acked:
            for packet in acked:
                del space.sent_packets[packet.packet_number]
            space.ack_eliciting_in_flight -= sum(packet.is_ack_eliciting for packet in acked)
            in_flight = [packet for packet in acked if packet.in_flight]
            self._cc.on_packets_acked(in_flight, now)  # type: ignore[arg-type]
            _notify_acked(acked)
        super().on_ack_received(ack_rangeset=ack_rangeset, ack_delay=ack_delay, now=now, space=space)
        if self._rtt_initialized:
            self._cc.round_trip = self._rtt_latest


def _acked_packets(space: QuicPacketSpace, ranges: RangeSet) -> list[SentPacket]:
    """The packets in flight that these ranges acknowledge, oldest first."""
    numbers = list(space.sent_packets)
    return [
        space.sent_packets[number]
        for each in ranges
        for number in numbers[bisect_left(numbers, each.start) : bisect_left(numbers, each.stop)]
    ]


def _notify_acked(packets: Sequence[SentPacket]) -> None:
    """Call the handlers of acknowledged packets, with consecutive parts of a stream combined into one call."""
    run: StreamPacket | None = None
    start = 0
    for packet in packets:
        if not isinstance(packet, StreamPacket):
            _call_handlers(packet.delivery_handlers)
            continue
        if packet.others:
            _call_handlers(packet.others)
        if run is not None and (packet.sender is not run.sender or packet.start != run.stop or run.fin):
            on_chunk_delivery(QuicDeliveryState.ACKED, run.sender, start, run.stop, run.fin)
            run = None
        if run is None:
            start = packet.start
        run = packet
    if run is not None:
        on_chunk_delivery(QuicDeliveryState.ACKED, run.sender, start, run.stop, run.fin)


def _call_handlers(handlers: Handlers) -> None:
    for handler, arguments in handlers:
        handler(QuicDeliveryState.ACKED, *arguments)
