"""Memory is bounded and every path is survived, on a simulated network."""

from __future__ import annotations

from tests.render.transport.simulated import Simulation, answer_all, frames
from tigas_render.transport.aioquic_ext.quic import RAISE_S


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


def test_a_large_upload_arrives() -> None:
    simulation = Simulation()
    stream_id = simulation.open(500_000)
    simulation.run()
    assert len(simulation.uploads[stream_id]) == 500_000


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


def test_the_largest_datagram_goes_through() -> None:
    simulation = Simulation()
    size = simulation.server.max_datagram_payload
    assert size > 1400
    simulation.server.send_datagram_frame(bytes(size))
    simulation.server.send_datagram_frame(b"next")
    simulation.run()
    assert [len(data) for data in simulation.datagrams] == [size, 4]


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


def largest(simulation: Simulation) -> int:
    """The most bytes of a datagram that carries the server's next frame, which arrives whole."""
    simulation.sent.clear()
    body = frames(1)[0]
    (stream_id,) = answer_all(simulation, [body])
    simulation.run()
    assert simulation.streams[stream_id] == body
    return max(size for _, sender, size in simulation.sent if sender == "server")


def test_datagrams_are_full_again_a_minute_after_an_outage() -> None:
    simulation = Simulation()
    assert largest(simulation) == 1452
    answer_all(simulation, frames(1))
    outage = simulation.now + 2.0
    simulation.drop = lambda sender, data: simulation.now < outage
    simulation.run()
    assert largest(simulation) == 1200
    loss = simulation.server._loss
    assert loss._cc._max_datagram_size == loss._pacer._max_datagram_size == 1200
    simulation.run(until=simulation.now + RAISE_S)
    largest(simulation)
    assert largest(simulation) == 1452
    assert loss._cc._max_datagram_size == loss._pacer._max_datagram_size == 1452
    assert simulation.server.max_datagram_payload > 1400


def test_a_path_that_stays_small_is_probed_once_a_minute_and_no_slower_for_it() -> None:
    simulation = Simulation()
    simulation.drop = lambda sender, data: len(data) > 1300
    largest(simulation)
    simulation.run(until=simulation.now + RAISE_S)
    window = simulation.server._loss.congestion_window
    assert largest(simulation) == 1452, "the probe"
    assert [largest(simulation) for _ in range(5)] == [1200] * 5
    assert simulation.server._loss.congestion_window >= window
    assert simulation.server._loss.bytes_in_flight == 0
