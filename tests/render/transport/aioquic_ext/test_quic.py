"""Memory is bounded, every path is survived, and a remote viewer can send a request at any time."""

from __future__ import annotations

import pytest

from tests.render.transport import simulated
from tests.render.transport.simulated import Simulation, frames
from tigas_common.limits import RateLimit
from tigas_render.transport.aioquic_ext.quic import MAX_STREAMS, MIN_STREAMS, SIZE_PROBE_INTERVAL_S, max_open_streams


def test_unsent_data_is_told_apart() -> None:
    simulation = Simulation()
    (stream_id,) = simulation.answer_all(frames(1, 300_000))
    assert simulation.server.unsent_bytes(stream_id) == 300_000
    simulation.play(0.001)
    assert 200_000 < simulation.server.unsent_bytes(stream_id) < 300_000
    assert not simulation.server.can_write(stream_id), "it was finished"
    simulation.run()
    assert simulation.server.unsent_bytes(stream_id) == 0
    assert simulation.server.total_unsent_bytes() == (0, 0)


def test_bytes_at_high_offsets_open_no_window() -> None:
    """The start of the upload is lost: later data must not make the server promise ever more memory."""
    simulation = Simulation()
    simulation.open(500_000)  # so that the client's congestion window is no limit any more
    simulation.run()
    stream_id = simulation.client.get_next_available_stream_id()
    simulation.client.send_stream_data(stream_id, bytes(1000))
    simulation.client.datagrams_to_send(simulation.now)  # lost
    simulation.client.send_stream_data(stream_id, bytes(500_000))
    promised = []

    def watch() -> None:
        if stream_id in simulation.server._streams:
            stream = simulation.server._streams[stream_id]
            promised.append(stream.max_stream_data_local - stream.receiver.starting_offset())

    simulation.run(step=watch)
    assert len(simulation.uploads[stream_id]) == 501_000
    assert max(promised) <= 64 * 1024


def test_the_window_opens_when_data_is_read() -> None:
    simulation = Simulation()
    stream_id = simulation.open(300_000)
    simulation.run(step=lambda: simulation.server.set_unread_bytes(stream_id, len(simulation.uploads[stream_id])))
    assert len(simulation.uploads[stream_id]) == 64 * 1024
    simulation.drop = lambda sender, data: simulation.now < read + 0.01
    read = simulation.now
    simulation.server.set_unread_bytes(stream_id, 0)  # nothing arrives in the meantime, and the announcement is lost
    simulation.run()
    assert len(simulation.uploads[stream_id]) == 300_000


def test_the_largest_datagram_goes_through() -> None:
    simulation = Simulation()
    size = simulation.server.max_datagram_payload
    assert size > 1400
    simulation.server.send_datagram_frame(bytes(size))
    simulation.server.send_datagram_frame(b"next")
    simulation.run()
    assert [len(data) for data in simulation.datagrams] == [size, 4]


def largest(simulation: Simulation) -> int:
    """The most bytes of a datagram that carries the server's next frame, which arrives whole."""
    simulation.sent.clear()
    simulation.exchange()
    return max(size for _, sender, size in simulation.sent if sender == "server")


def test_datagrams_are_full_again_a_minute_after_an_outage() -> None:
    simulation = Simulation()
    assert largest(simulation) == 1452
    simulation.answer_all(frames(1))
    outage = simulation.now + 2.0
    simulation.drop = lambda sender, data: simulation.now < outage
    simulation.run()
    assert largest(simulation) == 1200
    loss = simulation.server._loss
    assert loss._cc._max_datagram_size == loss._pacer._max_datagram_size == 1200
    simulation.play(SIZE_PROBE_INTERVAL_S)
    largest(simulation)
    assert largest(simulation) == 1452
    assert loss._cc._max_datagram_size == loss._pacer._max_datagram_size == 1452
    assert simulation.server.max_datagram_payload > 1400


def test_a_path_that_swallows_large_packets_is_survived_and_probed_once_a_minute() -> None:
    simulation = Simulation()
    simulation.drop = lambda sender, data: len(data) > 1300
    simulation.server.send_datagram_frame(bytes(simulation.server.max_datagram_payload))
    simulation.exchange()
    assert simulation.server.max_datagram_payload < 1200
    simulation.server.send_datagram_frame(b"small")
    simulation.run()
    assert simulation.datagrams == [b"small"]
    simulation.play(SIZE_PROBE_INTERVAL_S)
    window = simulation.server._loss.congestion_window
    assert largest(simulation) == 1452, "the probe"
    assert [largest(simulation) for _ in range(5)] == [1200] * 5
    assert simulation.server._loss.congestion_window >= window, "it costs no speed"
    assert simulation.server._loss.bytes_in_flight == 0


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
    simulation.play(5)
    assert len(simulation.uploads) == max_open_streams(2 * simulated.DELAY)


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
        if not (delay := limit.delay_s("a", now, rate, burst_s=1.0)):
            limit.consume("a", now, rate)
        return delay

    simulation = Simulation(reset_delay)
    began, asked = simulation.now, 0
    for moment in range(100 * seconds):
        asked += reset_all(simulation)
        simulation.run(until=began + moment / 100)
    window = max_open_streams(2 * simulated.DELAY)
    assert rate * seconds < asked <= window + rate * (seconds + 1) + 1


def test_a_client_that_waits_for_credit_gets_it_by_itself() -> None:
    limited = [0.5]
    simulation = Simulation(lambda now: limited.pop() if limited else 0.0)
    asked = reset_all(simulation)
    simulation.play(1)
    assert not limited
    assert reset_all(simulation) >= asked


def test_the_window_follows_the_round_trip() -> None:
    assert max_open_streams(0.0) == max_open_streams(0.01) == MIN_STREAMS
    assert MIN_STREAMS < max_open_streams(0.1) < max_open_streams(0.2) < max_open_streams(10.0) == MAX_STREAMS
