"""Packets are spread over the round trip."""

from __future__ import annotations

from tests.render.transport.simulated import Simulation, answer_all, frames


def test_packets_are_paced() -> None:
    """A large answer after the window has grown leaves spread over the round trip, not as one burst."""
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
