"""NewReno that does not take silence for success.

A frame server is idle between frames. aioquic's controllers grow the window with every acknowledgement even when the
window was never full, so after a minute of small frames it is meaningless, and the first large frame leaves as one
burst that a 5 Mbit/s link drops. RFC 9002, 7.8: a window that is not used does not grow.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Self

from aioquic.quic.congestion.base import register_congestion_control
from aioquic.quic.congestion.reno import RenoCongestionControl
from aioquic.quic.packet_builder import QuicSentPacket

RENO = "tigas-reno"
"""The controller's name in aioquic's configuration."""


class LimitedReno(RenoCongestionControl):
    """NewReno (RFC 9002) with a window that grows only for packets sent while it was full; handles batches."""

    def __init__(self, *, max_datagram_size: int) -> None:
        super().__init__(max_datagram_size=max_datagram_size)
        self._full_at = -1  # number of the last packet that left no room for another

    def set_datagram_size(self, size: int) -> None:
        """Grow and shrink the window in steps of another size."""
        self._max_datagram_size = size

    def started_over(self, now: float) -> Self:
        """A controller in the initial state, on which packets now in flight have no effect."""
        fresh = type(self)(max_datagram_size=self._max_datagram_size)
        fresh.bytes_in_flight = self.bytes_in_flight
        fresh._congestion_recovery_start_time = now
        return fresh

    def on_packet_sent(self, *, packet: QuicSentPacket) -> None:
        """As `on_packets_sent`."""
        self.on_packets_sent((packet,))

    def on_packet_acked(self, *, now: float, packet: QuicSentPacket) -> None:
        """As `on_packets_acked`."""
        self.on_packets_acked((packet,), now)

    def on_packets_sent(self, packets: Sequence[QuicSentPacket]) -> None:
        """Count packets, in the order of their numbers, and remember whether they fill the window."""
        self.bytes_in_flight += sum(packet.sent_bytes for packet in packets)
        if self.bytes_in_flight + self._max_datagram_size > self.congestion_window:
            self._full_at = packets[-1].packet_number

    def on_packets_acked(self, packets: Sequence[QuicSentPacket], now: float) -> None:
        """Grow the window for those of the packets, in the order of their numbers, that were sent while it was full."""
        first_spare = bisect_right(packets, self._full_at, key=_number)
        for packet in packets[:first_spare]:
            super().on_packet_acked(now=now, packet=packet)
        self.bytes_in_flight -= sum(packet.sent_bytes for packet in packets[first_spare:])


def _number(packet: QuicSentPacket) -> int:
    return packet.packet_number


register_congestion_control(RENO, LimitedReno)
