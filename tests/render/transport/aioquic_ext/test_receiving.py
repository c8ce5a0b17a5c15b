"""Packets are received, and acknowledged in time and at minimum cost."""

from __future__ import annotations

import random

import pytest
from aioquic.tls import Epoch

from tests.render.transport.simulated import CLIENT, DELAY, Simulation, answer_all, frames
from tigas_render.transport.aioquic_ext import receiving

SETTLED = 5.0
"""Seconds after which a new connection is quiet."""


def settled() -> Simulation:
    simulation = Simulation()
    simulation.open()
    simulation.run(until=SETTLED)
    simulation.sent.clear()
    return simulation


def from_server(simulation: Simulation) -> list[tuple[float, int]]:
    """When it sent how much, since it had the request."""
    return [(time - SETTLED - DELAY, size) for time, sender, size in simulation.sent if sender == "server"]


def test_a_frame_takes_the_acknowledgement_along() -> None:
    simulation = settled()
    stream_id = simulation.open(300)
    simulation.run(until=SETTLED + DELAY + 0.005)
    assert from_server(simulation) == []
    simulation.server.send_stream_data(stream_id, bytes(5000), end_stream=True)
    simulation.run(until=SETTLED + 2 * DELAY + 0.015)
    assert [size > 500 for _, size in from_server(simulation)] == [True] * 4
    assert not simulation.client._loss.spaces[-1].ack_eliciting_in_flight


def test_a_request_that_is_not_answered_is_acknowledged_soon() -> None:
    simulation = settled()
    simulation.open(300)
    simulation.run(until=SETTLED + 1)
    ((time, size),) = from_server(simulation)
    assert 0.010 < time < 0.025
    assert size < 100


def test_two_requests_are_acknowledged_at_once() -> None:
    simulation = settled()
    simulation.open(1200)
    simulation.open(1200)
    simulation.run(until=SETTLED + 1)
    ((time, _),) = from_server(simulation)
    assert time < 0.001


def test_a_request_after_a_lost_one_is_acknowledged_at_once() -> None:
    simulation = settled()
    simulation.open(300)
    simulation.client.datagrams_to_send(simulation.now)  # lost
    simulation.open(300)
    simulation.run(until=SETTLED + DELAY + 0.005)
    ((time, _),) = from_server(simulation)
    assert time < 0.001


def test_duplicates_and_spoilt_datagrams_change_nothing() -> None:
    simulation = settled()
    stream_id = simulation.open(300)
    ((data, _),) = simulation.client.datagrams_to_send(simulation.now)
    spoilt = bytearray(data)
    spoilt[-1] ^= 1
    for each in (bytes(spoilt), data[:15], data, data):
        simulation.server.receive_datagram(each, CLIENT, simulation.now)
    simulation._events()
    assert simulation.uploads[stream_id] == bytes(300)


def test_new_keys_are_followed() -> None:
    simulation = settled()
    simulation.client.request_key_update()
    bodies = frames(2)
    streams = answer_all(simulation, bodies)
    simulation.run()
    assert [bytes(simulation.streams[each]) for each in streams] == bodies
    simulation.server.request_key_update()
    more = frames(3)
    streams = answer_all(simulation, more)
    simulation.run()
    assert [bytes(simulation.streams[each]) for each in streams] == more


@pytest.mark.parametrize("packets", [1, 50])
@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_keys_are_renewed_and_the_connection_goes_on(
    monkeypatch: pytest.MonkeyPatch, packets: int, loss: float
) -> None:
    monkeypatch.setattr(receiving, "KEY_PACKETS", packets)
    simulation = settled()
    generator = random.Random(7)
    simulation.drop = lambda sender, data: generator.random() < loss
    keys = set()

    def watch() -> None:
        keys.add(simulation.client._cryptos[Epoch.ONE_RTT].recv.secret)

    for _ in range(5):
        bodies = frames(3)
        streams = answer_all(simulation, bodies)
        simulation.run(step=watch)
        assert [bytes(simulation.streams[each]) for each in streams] == bodies
    sent = sum(sender == "server" for _, sender, _ in simulation.sent)
    assert 5 <= len(keys) <= 2 + sent / packets


def test_a_request_sent_before_the_client_hears_of_new_keys_arrives(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = settled()
    answer_all(simulation, frames(1))
    monkeypatch.setattr(receiving, "KEY_PACKETS", 1)
    before = simulation.server._cryptos[Epoch.ONE_RTT].send.secret
    simulation._send("server", simulation.server)
    assert simulation.server._cryptos[Epoch.ONE_RTT].send.secret != before
    stream_id = simulation.open(300)
    simulation.run(until=simulation.now + DELAY + 0.001)
    assert simulation.uploads[stream_id] == bytes(300)


def test_uploads_arrive_whole_whatever_is_lost() -> None:
    simulation = Simulation()
    generator = random.Random(6)
    simulation.drop = lambda sender, data: generator.random() < 0.1
    stream_id = simulation.open(300_000)
    simulation.run()
    assert len(simulation.uploads[stream_id]) == 300_000
