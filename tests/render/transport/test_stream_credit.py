"""A viewer far away may ask in every moment, and nobody may open streams without end."""

from __future__ import annotations

import pytest

from tests.render.transport import simulated
from tests.render.transport.simulated import Simulation
from tigas_render.transport.stream_credit import LEAST, MOST, stream_window


@pytest.mark.parametrize(("round_trip_s", "rate"), [(0.002, 120), (0.04, 120), (0.3, 60)])
@pytest.mark.parametrize("cancels", [False, True])
def test_a_viewer_is_never_kept_waiting(
    round_trip_s: float, rate: int, cancels: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated, "DELAY", round_trip_s / 2)
    simulation = Simulation()
    began = simulation.now
    asked: list[int] = []
    answered: set[int] = set()

    def answer() -> None:
        for stream_id in [stream_id for stream_id in simulation.uploads if stream_id not in answered]:
            answered.add(stream_id)
            if simulation.server.can_write(stream_id):
                simulation.server.send_stream_data(stream_id, bytes(6000), end_stream=True)

    kept_waiting = 0
    for number in range(3 * rate):
        simulation.run(until=began + number / rate, step=answer)
        asked.append(simulation.open(size=500))
        if cancels and number % 2 and asked[number - 1] in simulation.client._streams:
            simulation.client.stop_stream(asked[number - 1], 0)
        simulation.run(until=simulation.now, step=answer)
        kept_waiting += len(simulation.client._streams_blocked_bidi)
    assert kept_waiting == 0
    simulation.run(step=answer)
    assert len(simulation.ended) >= 3 * rate / (2 if cancels else 1)


def test_who_finishes_no_stream_may_open_only_a_few() -> None:
    simulation = Simulation()
    for _ in range(200):
        simulation.open()
    simulation.run(until=simulation.now + 5)
    assert len(simulation.uploads) == stream_window(2 * simulated.DELAY)


def test_the_window_follows_the_round_trip() -> None:
    assert stream_window(0.0) == stream_window(0.01) == LEAST
    assert LEAST < stream_window(0.1) < stream_window(0.2) < stream_window(10.0) == MOST
