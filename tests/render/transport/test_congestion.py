"""The window follows what the network carries, not what was never sent."""

from __future__ import annotations

import pytest

from tests.render.transport.simulated import Simulation, answer_all, frames
from tigas_render.transport.congestion import CongestionControl, algorithm


@pytest.mark.parametrize("congestion_control", ["reno", "cubic"])
def test_a_window_that_is_not_used_does_not_grow(congestion_control: CongestionControl) -> None:
    simulation = Simulation(congestion_control)
    for body in frames(200, 3000):
        answer_all(simulation, [body])
        simulation.run()
    assert simulation.server._loss.congestion_window < 30_000
    answer_all(simulation, frames(1, 400_000))
    simulation.run()
    assert simulation.server._loss.congestion_window > 60_000


def test_an_unknown_congestion_control_is_refused() -> None:
    with pytest.raises(ValueError, match="reno, cubic"):
        algorithm("bbr")  # type: ignore[arg-type]
