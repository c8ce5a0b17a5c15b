"""Congestion control that tolerates random loss: NewReno with the path's capacity as the minimum window.

NewReno halves its window at each loss, so a random loss of 1 % keeps it at 12 packets (Mathis et al., 1997), however
fast the link is. After a loss this controller keeps

    max(window / 2, min(window, bandwidth · minimum round trip))

as TCP Westwood does (Mascolo et al., MobiCom 2001), with the delivery rate of BBR (draft-ietf-ccwg-bbr, 4.5.2) as the
bandwidth. If there is a full queue, that is the capacity of the link, so the queue drains. If there is no queue, the
loss is random: the window stays, and data is worth sending twice (copies.py). The window grows as in NewReno, so other
flows get the same share.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from aioquic.quic.congestion.base import register_congestion_control
from aioquic.quic.packet_builder import QuicSentPacket

from tigas_render.transport.aioquic_ext.congestion import LimitedReno

WESTWOOD = "tigas-westwood"
"""The controller's name in aioquic's configuration."""
BANDWIDTH_S = 2.0
"""Window in seconds of the maximum delivery rate, which estimates the bandwidth."""
ROUND_TRIP_S = 10.0
"""Window in seconds of the minimum round trip. Gaps between frames drain queues, so it has no queueing delay."""
MIN_INTERVAL_S = 0.002
"""Minimum interval in seconds for a delivery rate; over shorter ones it is timer noise."""
MAX_RANDOM_LOSS = 0.06
"""Share of lost packets above which loss means congestion, for example at a policer or a very short queue."""
LOSS_WINDOW_PACKETS = 500
"""Approximate number of packets over which that share is averaged."""
MIN_PACKETS = 50
"""Number of acknowledged packets after which that share is meaningful."""
LOSSY_S = 2.0
"""Seconds after a loss for which data is sent twice."""
QUEUED_RTT_RATIO = 1.25
"""Multiple of the minimum round trip above which a round trip reveals a queue."""


class _Burst(NamedTuple):
    """The delivery state when a burst of packets was sent."""

    number: int
    """Number of its first packet."""
    delivered: int
    """Bytes delivered before it."""
    delivered_at: float
    first_sent_at: float


class DeliveryRate:
    """The network's delivery rate in bytes per second, sampled with each acknowledgement."""

    def __init__(self) -> None:
        self._bursts: deque[_Burst] = deque()
        self._delivered = 0
        self._delivered_at = 0.0
        self._first_sent_at = 0.0

    def on_burst_sent(self, number: int, now: float, idle: bool) -> None:
        """Record a burst. number: its first packet's. idle: whether nothing was in flight before it."""
        if idle:
            self._delivered_at = self._first_sent_at = now
        self._bursts.append(_Burst(number, self._delivered, self._delivered_at, self._first_sent_at))

    def on_acked(self, newest: QuicSentPacket, size: int, now: float) -> float | None:
        """A sample of the rate, from the newest of the packets acknowledged now, which have `size` bytes in total."""
        self._delivered += size
        self._delivered_at = now
        bursts = self._bursts
        while len(bursts) > 1 and bursts[1].number <= newest.packet_number:
            bursts.popleft()
        if not bursts or bursts[0].number > newest.packet_number:  # reordered
            return None
        burst = bursts[0]
        assert newest.sent_time is not None
        self._first_sent_at = newest.sent_time
        interval = max(newest.sent_time - burst.first_sent_at, now - burst.delivered_at)
        return (self._delivered - burst.delivered) / interval if interval > MIN_INTERVAL_S else None


class _SlidingMaximum:
    """A sliding maximum over the last seconds, in amortised constant time."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._values: deque[tuple[float, float]] = deque()

    def add(self, value: float, now: float) -> None:
        values = self._values
        while values and values[-1][1] <= value:
            values.pop()
        values.append((now, value))
        while values[0][0] < now - self._seconds:
            values.popleft()

    @property
    def maximum(self) -> float | None:
        return self._values[0][1] if self._values else None


class Westwood(LimitedReno):
    """NewReno that tolerates up to 6 % of random loss."""

    def __init__(self, *, max_datagram_size: int) -> None:
        super().__init__(max_datagram_size=max_datagram_size)
        self._rate = DeliveryRate()
        self._bandwidth = _SlidingMaximum(BANDWIDTH_S)
        self._shortest = _SlidingMaximum(ROUND_TRIP_S)  # of negative round trips, so the maximum is the minimum
        self._acked = self._lost = 0.0
        self._lost_at = -math.inf

    def on_packets_sent(self, packets: Sequence[QuicSentPacket]) -> None:
        """Like NewReno's, but also starts a sample of the delivery rate."""
        first = packets[0]
        assert first.sent_time is not None
        self._rate.on_burst_sent(first.packet_number, first.sent_time, idle=not self.bytes_in_flight)
        super().on_packets_sent(packets)

    def on_packets_acked(self, packets: Sequence[QuicSentPacket], now: float) -> None:
        """Like NewReno's, but also takes a sample of the delivery rate."""
        if not packets:
            return
        rate = self._rate.on_acked(packets[-1], sum(packet.sent_bytes for packet in packets), now)
        if rate is not None:
            self._bandwidth.add(rate, now)
        kept = 1 - len(packets) / LOSS_WINDOW_PACKETS if len(packets) < LOSS_WINDOW_PACKETS else 0.0
        self._acked = self._acked * kept + len(packets)
        self._lost *= kept
        super().on_packets_acked(packets, now)

    def on_rtt_measurement(self, *, now: float, rtt: float) -> None:
        """Like NewReno's, but also tracks the minimum round trip, in seconds."""
        self._shortest.add(-rtt, now)
        super().on_rtt_measurement(now=now, rtt=rtt)

    def on_packets_lost(self, *, now: float, packets: Iterable[QuicSentPacket]) -> None:
        """Shrink the window to the path's capacity, or to half of itself if the loss is too high to be random.

        Without a queue the window stays, because the capacity is underestimated while frames do not fill the link.
        """
        packets = list(packets)
        self._lost += len(packets)
        self._lost_at = now
        before = self.congestion_window, self.ssthresh
        super().on_packets_lost(now=now, packets=packets)
        bandwidth, shortest = self._bandwidth.maximum, self._shortest.maximum
        if bandwidth is None or shortest is None or self._is_congested:
            return
        if not self._has_queue:
            self.congestion_window, self.ssthresh = before
        elif self.congestion_window < before[0]:
            capacity = int(bandwidth * -shortest)
            self.congestion_window = self.ssthresh = max(self.congestion_window, min(before[0], capacity))

    def should_duplicate(self, now: float) -> bool:
        """Whether data is worth sending twice: packets were lost recently although the path has no queue."""
        return now - self._lost_at < LOSSY_S and not self._has_queue and not self._is_congested

    @property
    def _has_queue(self) -> bool:
        shortest = self._shortest.maximum
        return shortest is None or self.round_trip > QUEUED_RTT_RATIO * -shortest

    @property
    def _is_congested(self) -> bool:
        return self._acked > MIN_PACKETS and self._lost > MAX_RANDOM_LOSS * self._acked


register_congestion_control(WESTWOOD, Westwood)
