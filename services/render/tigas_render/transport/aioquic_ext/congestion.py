"""Congestion control and pacing for a server that is idle between frames.

aioquic's controllers grow the window with every acknowledgement, even if it was never full. After a minute of small
frames the window would therefore mean nothing, and the first large frame would leave in a single burst, which a
5 Mbit/s link drops. Here an underused window does not grow, as RFC 9002, 7.8, requires.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from operator import attrgetter
from typing import Self

from aioquic.quic.congestion.base import register_congestion_control
from aioquic.quic.congestion.reno import RenoCongestionControl
from aioquic.quic.packet_builder import QuicSentPacket
from aioquic.quic.recovery import K_MICRO_SECOND, K_SECOND, QuicPacketPacer

RENO = "tigas-reno"
"""The controller's name in aioquic's configuration."""

GAIN = 1.25
"""Pacing rate as a multiple of window / round trip, so that acknowledgements and not the pacer limit the speed
(RFC 9002, 7.7)."""
TICK = 0.001
"""Timer resolution of uvloop and epoll in seconds. Linux' TCP also sends about this much at once."""
MIN_BURST = 2
MAX_BURST = 16
"""Limits on the number of packets that may leave at once after a pause; MAX_BURST packets are also worth a wake-up."""
MAX_WAIT = 0.004
"""Maximum time in seconds for which a packet waits so that others can leave with it."""


class LimitedReno(RenoCongestionControl):
    """NewReno (RFC 9002) with a window that grows only for packets sent while it was full. Handles batches."""

    def __init__(self, *, max_datagram_size: int) -> None:
        super().__init__(max_datagram_size=max_datagram_size)
        self._full_at = -1  # number of the last packet that left no room for another
        self.round_trip = math.inf
        """The latest round trip in seconds, without the client's acknowledgement delay."""

    def set_datagram_size(self, size: int) -> None:
        """Set the datagram size in bytes, in steps of which the window grows and shrinks."""
        self._max_datagram_size = size

    def should_duplicate(self, now: float) -> bool:
        """Whether data is worth sending twice."""
        return False

    def restarted_copy(self, now: float) -> Self:
        """A controller in its initial state, which ignores the packets now in flight."""
        fresh = type(self)(max_datagram_size=self._max_datagram_size)
        fresh.bytes_in_flight = self.bytes_in_flight
        fresh._congestion_recovery_start_time = now
        return fresh

    def on_packet_sent(self, *, packet: QuicSentPacket) -> None:
        self.on_packets_sent((packet,))

    def on_packet_acked(self, *, now: float, packet: QuicSentPacket) -> None:
        self.on_packets_acked((packet,), now)

    def on_packets_sent(self, packets: Sequence[QuicSentPacket]) -> None:
        """Count packets, sorted by number, and remember whether they fill the window."""
        self.bytes_in_flight += sum(packet.sent_bytes for packet in packets)
        if self.bytes_in_flight + self._max_datagram_size > self.congestion_window:
            self._full_at = packets[-1].packet_number

    def on_packets_acked(self, packets: Sequence[QuicSentPacket], now: float) -> None:
        """Grow the window for the packets, sorted by number, that were sent while it was full."""
        first_spare = bisect_right(packets, self._full_at, key=attrgetter("packet_number"))
        for packet in packets[:first_spare]:
            super().on_packet_acked(now=now, packet=packet)
        self.bytes_in_flight -= sum(packet.sent_bytes for packet in packets[first_spare:])


register_congestion_control(RENO, LimitedReno)


class TickPacer(QuicPacketPacer):
    """Releases all packets of a time slice at once.

    aioquic's own pacer allows 16 packets and then asks to be woken for each further one. With timers of a millisecond
    that limits the rate to about 180 Mbit/s, and batches are too small for segmentation offload.
    """

    def next_send_time(self, now: float) -> float | None:  # type: ignore[override]  # aioquic's returns None as well
        if self.packet_time is not None:
            self.update_bucket(now=now)
            if self.bucket_time <= 0:
                return now + max(self.packet_time, TICK)
        return None

    def allowance(self, now: float, most: int) -> int:
        """The number of packets, up to `most`, that consecutive calls of `next_send_time` would release now."""
        if self.packet_time is None:
            return most
        self.update_bucket(now=now)
        return min(most, max(0, math.ceil(self.bucket_time / self.packet_time)))

    def next_burst(self, now: float, waiting: int) -> float:
        """When to send again once `allowance` is used up, given the number of waiting packets."""
        assert self.packet_time is not None
        return now + max(TICK, min(min(waiting, MAX_BURST) * self.packet_time, MAX_WAIT))

    def update_after_sends(self, count: int) -> None:
        """Like `update_after_send`, for `count` packets released by `allowance`."""
        if self.packet_time is not None:
            self.bucket_time = max(0.0, self.bucket_time - count * self.packet_time)

    def update_rate(self, congestion_window: int, smoothed_rtt: float) -> None:
        size = self._max_datagram_size
        rate = GAIN * congestion_window / max(smoothed_rtt, K_MICRO_SECOND)
        self.packet_time = max(K_MICRO_SECOND, min(size / rate, K_SECOND))
        burst = max(MIN_BURST * size, min(congestion_window // 4, MAX_BURST * size))
        worthwhile = min(MAX_BURST * self.packet_time, MAX_WAIT) + TICK
        self.bucket_max = max(burst / rate, worthwhile, 2 * TICK)
        self.bucket_time = min(self.bucket_time, self.bucket_max)
