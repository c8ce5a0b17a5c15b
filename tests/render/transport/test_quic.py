"""Our changes to aioquic's connection, on a simulated network: everything arrives, in order, within bounds."""

from __future__ import annotations

import random

import pytest

from tests.render.transport.simulated import Simulation
from tigas_render.transport.congestion import CongestionControl, algorithm


def frames(count: int, size: int = 100_000) -> list[bytes]:
    generator = random.Random(4)
    return [generator.randbytes(size) for _ in range(count)]


def answer_all(simulation: Simulation, bodies: list[bytes]) -> list[int]:
    """Open a stream for each body, let the requests arrive, and answer them all at once."""
    streams = [simulation.open() for _ in bodies]
    simulation.run()
    for stream_id, body in zip(streams, bodies, strict=True):
        simulation.server.send_stream_data(stream_id, body, end_stream=True)
    return streams


@pytest.mark.parametrize("loss", [0.0, 0.02, 0.2])
@pytest.mark.parametrize("congestion_control", ["reno", "cubic"])
def test_streams_arrive_whole_whatever_is_lost(loss: float, congestion_control: CongestionControl) -> None:
    simulation = Simulation(congestion_control)
    generator = random.Random(5)
    simulation.drop = lambda sender, data: generator.random() < loss
    bodies = frames(5)
    streams = answer_all(simulation, bodies)
    simulation.run()
    assert [bytes(simulation.streams[stream_id]) for stream_id in streams] == bodies


def test_the_oldest_frame_arrives_first() -> None:
    simulation = Simulation()
    streams = answer_all(simulation, frames(6))
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
    first, second = answer_all(simulation, bodies)
    simulation.run(until=simulation.now + 0.1)
    assert 0 < len(simulation.streams[first]) < 400_000
    simulation.server.reset_stream(first, 0)
    simulation.run()
    assert len(simulation.streams[first]) < 400_000
    assert simulation.streams[second] == bodies[1]


def test_finished_streams_leave_nothing_behind() -> None:
    simulation = Simulation()
    for _ in range(3):
        answer_all(simulation, frames(100, 2000))
        simulation.run()
    simulation.open()  # one more round trip, so that the last acknowledgements are in
    simulation.run()
    assert len(simulation.ended) == 300
    assert len(simulation.server._streams) <= 1
    assert len(simulation.server._streams_queue) <= 1
    assert simulation.server._loss.bytes_in_flight == 0


def test_unsent_data_is_told_apart() -> None:
    simulation = Simulation()
    (stream_id,) = answer_all(simulation, frames(1, 300_000))
    assert simulation.server.unsent(stream_id) == 300_000
    simulation.run(until=simulation.now + 0.001)
    assert 200_000 < simulation.server.unsent(stream_id) < 300_000
    assert not simulation.server.can_write(stream_id), "it was finished"
    simulation.run()
    assert simulation.server.unsent(stream_id) == 0
    assert simulation.server.unsent_total() == (0, 0)


# -- receiving ---------------------------------------------------------------------------------------------------------


def test_a_large_upload_arrives() -> None:
    simulation = Simulation()
    stream_id = simulation.open(500_000)
    simulation.run()
    assert len(simulation.uploads[stream_id]) == 500_000


def test_bytes_at_high_offsets_open_no_window() -> None:
    """The start of the upload is lost: what comes after it must not make the server promise ever more memory."""
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


# -- datagrams ---------------------------------------------------------------------------------------------------------


def test_the_largest_datagram_goes_through() -> None:
    simulation = Simulation()
    size = simulation.server.max_datagram_payload
    assert size > 1400
    simulation.server.send_datagram_frame(bytes(size))
    simulation.server.send_datagram_frame(b"next")
    simulation.run()
    assert [len(data) for data in simulation.datagrams] == [size, 4]


# -- path MTU ----------------------------------------------------------------------------------------------------------


def test_a_path_that_swallows_large_packets_is_survived() -> None:
    simulation = Simulation()
    simulation.drop = lambda sender, data: len(data) > 1300
    body = frames(1)[0]
    (stream_id,) = answer_all(simulation, [body])
    simulation.server.send_datagram_frame(bytes(simulation.server.max_datagram_payload))
    simulation.run()
    assert simulation.streams[stream_id] == body
    assert simulation.server.max_datagram_payload < 1200
    simulation.server.send_datagram_frame(b"small")
    simulation.run()
    assert simulation.datagrams == [b"small"]


# -- pace and window ---------------------------------------------------------------------------------------------------


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
