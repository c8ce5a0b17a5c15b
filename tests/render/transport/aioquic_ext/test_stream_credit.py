"""A remote viewer can send a request at any time, and no client can open streams without limit."""

from __future__ import annotations

import pytest

from benchmarks.loss import Simulation
from tests.render.transport import simulated
from tigas_common.limits import RateLimit
from tigas_render.transport.aioquic_ext.quic import MAX_STREAMS, MIN_STREAMS, stream_window


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


def reset_all(simulation: Simulation) -> int:
    """Open as many streams as the server allows, and take them back at once. Returns how many they were."""
    client, count = simulation.client, 0
    while (stream_id := client.get_next_available_stream_id()) // 4 < client._remote_max_streams_bidi:
        client.send_stream_data(stream_id, b"{")
        client.stop_stream(stream_id, 0)
        client.reset_stream(stream_id, 0)
        count += 1
    return count


def test_streams_that_are_reset_are_replaced_at_a_limited_rate() -> None:
    limit, rate, seconds = RateLimit[str](), 20.0, 5

    def reset_delay(now: float) -> float:
        if not (delay := limit.delay("a", now, rate, burst_s=1.0)):
            limit.use("a", now, rate)
        return delay

    simulation = Simulation(reset_delay=reset_delay)
    began, asked = simulation.now, 0
    for moment in range(100 * seconds):
        asked += reset_all(simulation)
        simulation.run(until=began + moment / 100)
    window = stream_window(2 * simulated.DELAY)
    assert rate * seconds < asked <= window + rate * (seconds + 1) + 1


def test_a_client_that_waits_for_credit_gets_it_by_itself() -> None:
    limited = [0.5]

    def reset_delay(now: float) -> float:
        return limited.pop() if limited else 0.0

    simulation = Simulation(reset_delay=reset_delay)
    asked = reset_all(simulation)
    simulation.run(until=simulation.now + 1)
    assert not limited
    assert reset_all(simulation) >= asked


def test_the_window_follows_the_round_trip() -> None:
    assert stream_window(0.0) == stream_window(0.01) == MIN_STREAMS
    assert MIN_STREAMS < stream_window(0.1) < stream_window(0.2) < stream_window(10.0) == MAX_STREAMS
