"""The window follows the network's capacity, not idle periods, and packets are spread over the round trip."""

from __future__ import annotations

from tests.render.transport.simulated import Simulation


def test_a_window_that_is_not_used_does_not_grow() -> None:
    simulation = Simulation()
    for _ in range(200):
        simulation.exchange(size=3000)
    assert simulation.server._loss.congestion_window < 30_000
    simulation.exchange(size=400_000)
    assert simulation.server._loss.congestion_window > 60_000


def test_a_large_answer_leaves_spread_over_the_round_trip_once_the_window_has_grown() -> None:
    simulation = Simulation()
    for _ in range(8):
        simulation.exchange()
    simulation.sent.clear()
    simulation.exchange(size=200_000)
    times = [time for time, sender, size in simulation.sent if sender == "server" and size > 1000]
    assert max(times.count(time) for time in times) <= 20
    assert times[-1] - times[0] < 0.2
