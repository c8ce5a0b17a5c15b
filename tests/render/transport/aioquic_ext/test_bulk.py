"""Stream data written in bulk arrives whole and in order, on a simulated network."""

from __future__ import annotations

import pytest

from tests.render.transport.simulated import Simulation, frames


@pytest.mark.parametrize("loss", [0.0, 0.02, 0.2])
def test_streams_arrive_whole_whatever_is_lost(loss: float) -> None:
    simulation = Simulation()
    simulation.lose(loss)
    simulation.exchange(5)
    stream_id = simulation.open(300_000)
    simulation.run()
    assert len(simulation.uploads[stream_id]) == 300_000


def test_the_oldest_frame_arrives_first() -> None:
    simulation = Simulation()
    streams = simulation.answer_all(frames(6))
    simulation.run()
    assert simulation.ended == streams
    packets = [size for _, sender, size in simulation.sent if sender == "server" and size > 1000]
    assert packets.count(1452) > 0.98 * len(packets), "packets are full"


def test_a_lost_packet_holds_up_its_own_frame_only() -> None:
    simulation = Simulation()
    lost: list[bytes] = []

    def lose_one(sender: str, data: bytes) -> bool:
        if sender == "client" or len(data) < 1452 or lost:
            return False
        lost.append(data)
        return True

    simulation.drop = lose_one
    first, second, third = simulation.answer_all(frames(3, 3000))
    simulation.run()
    assert simulation.ended == [second, third, first]


def test_with_requests_in_flight_the_frame_rate_does_not_depend_on_the_round_trip(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tests.render.transport.simulated.DELAY", 0.15)
    (body,) = frames(1, 25_000)

    def per_second(in_flight: int) -> float:
        simulation = Simulation()
        answered: set[int] = set()
        opened = 0

        def go_on() -> None:
            nonlocal opened
            for stream_id in simulation.uploads.keys() - answered:
                answered.add(stream_id)
                simulation.server.send_stream_data(stream_id, body, end_stream=True)
            while opened - len(simulation.ended) < in_flight:
                simulation.open()
                opened += 1

        go_on()
        simulation.run(until=simulation.now + 3, step=go_on)
        before = len(simulation.ended)
        simulation.run(until=simulation.now + 3, step=go_on)
        return (len(simulation.ended) - before) / 3

    assert per_second(1) < 4
    assert per_second(16) > 25


def test_an_end_without_data_arrives() -> None:
    simulation = Simulation()
    stream_id = simulation.open()
    simulation.run()
    simulation.server.send_stream_data(stream_id, b"data")
    simulation.run()
    assert simulation.ended == []
    simulation.server.send_stream_data(stream_id, b"", end_stream=True)
    simulation.run()
    assert simulation.ended == [stream_id]


def test_a_reset_stops_a_stream_and_no_other() -> None:
    simulation = Simulation()
    bodies = frames(2, 400_000)
    first, second = simulation.answer_all(bodies)
    simulation.play(0.1)
    assert 0 < len(simulation.streams[first]) < 400_000
    simulation.server.reset_stream(first, 0)
    simulation.run()
    assert len(simulation.streams[first]) < 400_000
    assert simulation.streams[second] == bodies[1]


def test_finished_streams_leave_nothing_behind() -> None:
    simulation = Simulation()
    for _ in range(30):
        simulation.exchange(10, 2000)
    simulation.open()  # one more round trip, so that the last acknowledgements are in
    simulation.run()
    assert len(simulation.ended) == 300
    assert len(simulation.server._streams) <= 1
    assert len(simulation.server._streams_queue) <= 1
    assert simulation.server._loss.bytes_in_flight == 0
