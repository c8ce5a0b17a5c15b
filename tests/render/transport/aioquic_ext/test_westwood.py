"""Random loss costs the window nothing; congestion does."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import pytest

from tests.render.transport.simulated import Simulation
from tigas_render.transport.aioquic_ext.congestion import RENO, LimitedReno
from tigas_render.transport.aioquic_ext.westwood import WESTWOOD, Westwood

SIZE = 1452
ROUND_TRIP = 0.1


@dataclass
class Packet:
    packet_number: int
    sent_time: float
    sent_bytes: int = SIZE


class Path:
    """A link of `rate` packets per second and an endless queue, on which a controller's window is always full."""

    def __init__(self, controller: LimitedReno, rate: float, window: int) -> None:
        controller.congestion_window = controller.ssthresh = window * SIZE
        self._controller = controller
        self._rate = rate
        self._now = self._free_at = 1.0
        self._number = 0
        self._arrivals: deque[tuple[float, Packet]] = deque()

    @property
    def window(self) -> float:
        """In packets."""
        return self._controller.congestion_window / SIZE

    def run(self, seconds: float, lose_every: int = 0) -> None:
        """Send and acknowledge; each `lose_every`-th packet gets lost."""
        end = self._now + seconds
        while self._now < end:
            while self._controller.bytes_in_flight + SIZE <= self._controller.congestion_window:
                packet = Packet(self._number, self._now)
                self._controller.on_packets_sent([packet])  # type: ignore[list-item]
                self._number += 1
                self._free_at = max(self._free_at, self._now) + 1 / self._rate
                self._arrivals.append((self._free_at + ROUND_TRIP, packet))
            self._now, packet = self._arrivals.popleft()
            if lose_every and packet.packet_number % lose_every == 0:
                self._controller.on_packets_lost(now=self._now, packets=[packet])  # type: ignore[list-item]
            else:
                self._controller.on_packets_acked([packet], self._now)  # type: ignore[list-item]
                round_trip = self._now - packet.sent_time
                self._controller.round_trip = round_trip  # as the connection does
                self._controller.on_rtt_measurement(now=self._now, rtt=round_trip)


def test_random_loss_on_an_empty_queue_costs_nothing() -> None:
    path = Path(Westwood(max_datagram_size=SIZE), rate=1000, window=50)
    path.run(1)
    before = path.window
    path.run(3, lose_every=100)
    assert path.window >= before


def test_a_loss_on_a_full_queue_leaves_what_the_link_carries() -> None:
    path = Path(Westwood(max_datagram_size=SIZE), rate=1000, window=70)
    path.run(11)  # grows a queue that is as long as the link's capacity
    assert path.window > 150
    path.run(0.3, lose_every=150)
    assert path.window == pytest.approx(1000 * ROUND_TRIP, rel=0.1)


def test_more_loss_than_a_radio_has_is_congestion() -> None:
    path = Path(Westwood(max_datagram_size=SIZE), rate=1000, window=60)
    path.run(1)
    path.run(3, lose_every=10)
    assert path.window < 20


def test_without_loss_it_is_newreno() -> None:
    windows = []
    for controller in (Westwood(max_datagram_size=SIZE), LimitedReno(max_datagram_size=SIZE)):
        path = Path(controller, rate=1000, window=20)
        path.run(2)
        windows.append(path.window)
    assert windows[0] == windows[1] > 30


def test_frames_on_a_lossy_path_come_sooner_than_with_newreno() -> None:
    took = {}
    for name in (RENO, WESTWOOD):
        simulation = Simulation(congestion_control=name)
        simulation.lose(0.02)
        begun = simulation.now
        for _ in range(40):
            simulation.exchange(size=60_000)
        took[name] = simulation.now - begun
    assert took[WESTWOOD] < 0.75 * took[RENO]
