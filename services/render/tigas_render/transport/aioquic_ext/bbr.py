"""BBRv3 (draft-ietf-ccwg-bbr-02), to compare with: a model of the path instead of a window that grows until a loss.

The bandwidth is the greatest delivery rate of the last two probing cycles; the window and the pace follow from it and
the least round trip. Losses of more than 2 % of a round bound the data in flight. Probing is as frequent as NewReno's
growth, so that both share a link.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Iterable, Sequence
from enum import Enum, auto

from aioquic.quic.congestion.base import register_congestion_control
from aioquic.quic.packet_builder import QuicSentPacket

from tigas_render.transport.aioquic_ext.congestion import LimitedReno
from tigas_render.transport.aioquic_ext.westwood import LOSSY_S, MOST_LOSS, QUEUE, DeliveryRate

BBR = "tigas-bbr"
"""The controller's name in aioquic's configuration."""
STARTUP_GAIN, DRAIN_GAIN = 2.77, 0.5
PACING = 0.99
"""Share of the estimated bandwidth that is used, so that queues drain."""
BETA = 0.7
LOSS_THRESHOLD = 0.02
MIN_RTT_S = 10.0
PROBE_RTT_EVERY_S, PROBE_RTT_S, PROBE_RTT_GAIN = 5.0, 0.2, 0.5
FULL_ROUNDS, FULL_GROWTH = 3, 1.25
STARTUP_LOSSES = 6
HEADROOM = 0.85
LEAST_WINDOW = 4
MOST_ROUNDS = 63


class State(Enum):
    STARTUP = auto()
    DRAIN = auto()
    DOWN = auto()
    CRUISE = auto()
    REFILL = auto()
    UP = auto()
    PROBE_RTT = auto()


GAINS = {
    State.STARTUP: (STARTUP_GAIN, 2.0),
    State.DRAIN: (DRAIN_GAIN, 2.0),
    State.DOWN: (0.9, 2.0),
    State.CRUISE: (1.0, 2.0),
    State.REFILL: (1.0, 2.0),
    State.UP: (1.25, 2.25),
    State.PROBE_RTT: (1.0, PROBE_RTT_GAIN),
}
"""Of the pace and of the window, by state."""


class Bbr(LimitedReno):
    """BBRv3's bandwidth model."""

    def __init__(self, *, max_datagram_size: int) -> None:
        super().__init__(max_datagram_size=max_datagram_size)
        self._rate = DeliveryRate()
        self._random = random.Random(1)
        self._state = State.STARTUP
        self._state_since = 0.0
        self._cycle = 0
        self._bandwidths: deque[tuple[int, float]] = deque()
        """Greatest delivery rates by probing cycle."""
        self._round_trips: deque[tuple[float, float]] = deque()
        self._min_rtt_at = -math.inf
        self._delivered = self._round_ends = 0
        self._sent_at: dict[int, int] = {}
        """Bytes delivered when a packet was sent, by its number."""
        self._limited_until = -1
        """Bytes delivered until which samples are limited by the application."""
        self._rounds = 0
        self._full_bandwidth, self._full_rounds = 0.0, 0
        self._round_lost = self._round_acked = self._round_losses = 0
        self._latest_bandwidth, self._latest_inflight = 0.0, 0
        self._bandwidth_lo = self._inflight_lo = self._inflight_hi = math.inf
        self._up_rounds = 0
        self._probe_at = 0.0
        self._rounds_at_probe = 0
        self._rounds_between = MOST_ROUNDS
        self._rtt_probed_at = 0.0
        self._lost_at = -math.inf
        self._acked_packets = self._lost_packets = 0.0

    def wants_copies(self, now: float) -> bool:
        """As Westwood's."""
        has_queue = self.round_trip > QUEUE * self.min_rtt
        return now - self._lost_at < LOSSY_S and not has_queue and self._lost_packets <= MOST_LOSS * self._acked_packets

    @property
    def bandwidth(self) -> float:
        """Bytes per second; 0 while unknown."""
        most = max((rate for _, rate in self._bandwidths), default=0.0)
        return min(most, self._bandwidth_lo)

    @property
    def min_rtt(self) -> float:
        return min((rtt for _, rtt in self._round_trips), default=math.inf)

    @property
    def pacing_rate(self) -> float | None:
        """Bytes per second; None while unknown."""
        rate = PACING * GAINS[self._state][0] * self.bandwidth
        return rate or None

    @property
    def _bdp(self) -> float:
        return self.bandwidth * self.min_rtt if self._round_trips else math.inf

    def on_packets_sent(self, packets: Sequence[QuicSentPacket]) -> None:
        first = packets[0]
        assert first.sent_time is not None
        self._rate.sent(first.packet_number, first.sent_time, idle=not self.bytes_in_flight)
        self.bytes_in_flight += sum(packet.sent_bytes for packet in packets)
        if self.bytes_in_flight + self._max_datagram_size <= self.congestion_window:
            self._limited_until = self._delivered + self.bytes_in_flight
        for packet in packets:
            self._sent_at[packet.packet_number] = self._delivered

    def on_packets_acked(self, packets: Sequence[QuicSentPacket], now: float) -> None:
        if not packets:
            return
        size = sum(packet.sent_bytes for packet in packets)
        self._acked_packets = 0.99 * self._acked_packets + len(packets)
        self._lost_packets *= 0.99
        self.bytes_in_flight -= size
        rate = self._rate.acknowledged(packets[-1], size, now)
        self._delivered += size
        self._round_acked += size
        before = max(self._sent_at.pop(packet.packet_number, 0) for packet in packets)
        is_round = before >= self._round_ends
        is_limited = before < self._limited_until
        if rate is not None:
            self._latest_bandwidth = max(self._latest_bandwidth, rate)
            if not is_limited or rate >= max((each for _, each in self._bandwidths), default=0.0):
                self._add_bandwidth(rate)
        self._latest_inflight = max(self._latest_inflight, self._delivered - before)
        if is_round:
            self._end_round(now, is_limited)
        self._advance(now)
        self._set_window(size)

    def on_rtt_measurement(self, *, now: float, rtt: float) -> None:
        if rtt <= self.min_rtt:
            self._min_rtt_at = now
        self._round_trips.append((now, rtt))
        while self._round_trips[0][0] < now - MIN_RTT_S:
            self._round_trips.popleft()

    def on_packets_lost(self, *, now: float, packets: Iterable[QuicSentPacket]) -> None:
        self._lost_at = now
        for packet in packets:
            self._lost_packets += 1
            self.bytes_in_flight -= packet.sent_bytes
            self._round_lost += packet.sent_bytes
            self._round_losses += 1
            self._sent_at.pop(packet.packet_number, None)
        if self._is_lossy and self._state is State.UP:
            self._inflight_hi = max(self._latest_inflight, BETA * self._bdp)
            self._enter(State.DOWN, now)

    @property
    def _is_lossy(self) -> bool:
        return self._round_lost > LOSS_THRESHOLD * (self._round_lost + self._round_acked)

    def _add_bandwidth(self, rate: float) -> None:
        while self._bandwidths and self._bandwidths[0][0] < self._cycle - 1:
            self._bandwidths.popleft()
        if self._bandwidths and self._bandwidths[-1][0] == self._cycle:
            rate = max(rate, self._bandwidths.pop()[1])
        self._bandwidths.append((self._cycle, rate))

    def _end_round(self, now: float, is_limited: bool) -> None:
        self._rounds += 1
        self._round_ends = self._delivered
        if self._state is State.STARTUP and not is_limited:
            if self.bandwidth >= FULL_GROWTH * self._full_bandwidth:
                self._full_bandwidth, self._full_rounds = self.bandwidth, 0
            else:
                self._full_rounds += 1
            if self._full_rounds >= FULL_ROUNDS:
                self._enter(State.DRAIN, now)
        if self._round_lost and self._state is State.STARTUP:
            if self._round_losses >= STARTUP_LOSSES and self._is_lossy:
                self._inflight_hi = max(self._bdp, self._latest_inflight)
                self._enter(State.DRAIN, now)
        elif self._round_lost and self._state not in (State.REFILL, State.UP):
            if math.isinf(self._bandwidth_lo):
                self._bandwidth_lo = self.bandwidth
            if math.isinf(self._inflight_lo):
                self._inflight_lo = self.congestion_window
            self._bandwidth_lo = max(self._latest_bandwidth, BETA * self._bandwidth_lo)
            self._inflight_lo = max(self._latest_inflight, BETA * self._inflight_lo)
        if self._state is State.UP and not is_limited and self.bytes_in_flight >= 0.9 * self._inflight_hi:
            self._inflight_hi += self._max_datagram_size * 2**self._up_rounds
            self._up_rounds += 1
        self._round_lost = self._round_acked = self._round_losses = 0
        self._latest_bandwidth, self._latest_inflight = 0.0, 0

    def _advance(self, now: float) -> None:
        """Go on to the next state."""
        state, since = self._state, now - self._state_since
        if state is State.DRAIN and self.bytes_in_flight <= self._bdp:
            self._enter(State.DOWN, now)
        elif state is State.DOWN and self.bytes_in_flight <= min(self._bdp, HEADROOM * self._inflight_hi):
            self._enter(State.CRUISE, now)
        elif state is State.CRUISE and self._is_time_to_probe(now):
            self._enter(State.REFILL, now)
        elif state is State.REFILL and self._rounds > self._rounds_at_probe + 1:
            self._enter(State.UP, now)
        elif state is State.UP and self._has_probed(since):
            self._enter(State.DOWN, now)
        elif state is State.PROBE_RTT and since > PROBE_RTT_S:
            self._rtt_probed_at = now
            self._enter(State.DOWN if self._full_rounds >= FULL_ROUNDS else State.STARTUP, now)
        if state is not State.PROBE_RTT and now - max(self._min_rtt_at, self._rtt_probed_at) > PROBE_RTT_EVERY_S:
            self._enter(State.PROBE_RTT, now)

    def _has_probed(self, since: float) -> bool:
        """After a queue's worth, or five rounds if the application limits the flow."""
        is_full = since > self.min_rtt and self.bytes_in_flight > 1.25 * self._bdp
        return is_full or self._rounds > self._rounds_at_probe + 5

    def _is_time_to_probe(self, now: float) -> bool:
        """After two to three seconds, or as many rounds as NewReno needs to grow by a path's worth."""
        window = min(self._bdp, self.congestion_window) / self._max_datagram_size
        rounds = min(MOST_ROUNDS, window)
        return now >= self._probe_at or self._rounds - self._rounds_at_probe >= rounds

    def _enter(self, state: State, now: float) -> None:
        if state is State.DOWN:
            self._cycle += 1
            self._probe_at = now + 2 + self._random.random()
            self._rounds_at_probe = self._rounds
            self._full_rounds = FULL_ROUNDS
        elif state is State.REFILL:
            self._bandwidth_lo = self._inflight_lo = math.inf
            self._rounds_at_probe = self._rounds
            self._up_rounds = 0
        self._state, self._state_since = state, now

    def _set_window(self, acked: int) -> None:
        size = self._max_datagram_size
        target = GAINS[self._state][1] * self._bdp + 3 * size
        window: float
        if self._state is State.STARTUP or math.isinf(target):
            window = self.congestion_window + acked if self.congestion_window < target else self.congestion_window
        else:
            window = min(target, self.congestion_window + acked)
        bound = self._inflight_hi
        if self._state in (State.CRUISE, State.PROBE_RTT):
            bound *= HEADROOM
        window = min(window, bound, self._inflight_lo)
        self.congestion_window = int(max(window, LEAST_WINDOW * size))


register_congestion_control(BBR, Bbr)
