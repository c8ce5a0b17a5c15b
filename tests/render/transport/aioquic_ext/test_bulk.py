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
