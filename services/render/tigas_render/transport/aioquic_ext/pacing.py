"""Pacing for an event loop with timers in milliseconds."""

from __future__ import annotations

import math

from aioquic.quic.recovery import K_MICRO_SECOND, K_SECOND, QuicPacketPacer

GAIN = 1.25
"""Pacing rate as a multiple of window / round trip, so that acknowledgements and not the pacer set the speed
(RFC 9002, 7.7)."""
TICK = 0.001
"""Seconds; the resolution of timers in uvloop and epoll, and the worth of one burst in Linux' TCP."""
MIN_BURST = 2
MAX_BURST = 16
"""Packets that may leave at once after a pause, at any rate, and that are worth a wake-up."""
MAX_WAIT = 0.004
"""The longest that a packet waits for others to leave with, in seconds."""


class TickPacer(QuicPacketPacer):
    """Releases the packets of a time slice at once.

    aioquic's own pacer allows 16 packets and then asks for a wake-up for the next one: with timers of a millisecond
    that is a ceiling of about 180 Mbit/s, and batches are too small for segmentation offload.
    """

    def next_send_time(self, now: float) -> float | None:  # type: ignore[override]  # aioquic's returns None as well
        if self.packet_time is not None:
            self.update_bucket(now=now)
            if self.bucket_time <= 0:
                return now + max(self.packet_time, TICK)
        return None

    def allowance(self, now: float, most: int) -> int:
        """How many of `most` packets `next_send_time` lets out now, one after the other."""
        if self.packet_time is None:
            return most
        self.update_bucket(now=now)
        return min(most, max(0, math.ceil(self.bucket_time / self.packet_time)))

    def next_burst(self, now: float, waiting: int) -> float:
        """Time to continue with this many waiting packets once `allowance` is used up: the last of them is not late."""
        assert self.packet_time is not None
        return now + max(TICK, min(min(waiting, MAX_BURST) * self.packet_time, MAX_WAIT))

    def update_after_sends(self, count: int) -> None:
        """Like `update_after_send` for this many packets released by `allowance`."""
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
