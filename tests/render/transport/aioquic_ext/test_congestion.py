"""The window follows the network's capacity, not idle periods, and packets are spread over the round trip."""

from __future__ import annotations

from tests.render.transport.simulated import Simulation, answer_all, frames


def test_a_window_that_is_not_used_does_not_grow() -> None:
    simulation = Simulation()
    for body in frames(200, 3000):
        answer_all(simulation, [body])
        simulation.run()
    assert simulation.server._loss.congestion_window < 30_000
    answer_all(simulation, frames(1, 400_000))
    simulation.run()
    assert simulation.server._loss.congestion_window > 60_000


def test_a_large_answer_leaves_spread_over_the_round_trip_once_the_window_has_grown() -> None:
    simulation = Simulation()
    for body in frames(8):
        answer_all(simulation, [body])
        simulation.run()
    simulation.sent.clear()
    answer_all(simulation, frames(1, 200_000))
    simulation.run()
    times = [time for time, sender, size in simulation.sent if sender == "server" and size > 1000]
    assert max(times.count(time) for time in times) <= 20
    assert times[-1] - times[0] < 0.2
