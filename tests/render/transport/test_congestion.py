"""The window follows the network's capacity, not idle periods."""

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
