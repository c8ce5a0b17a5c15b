"""Packets are received from wherever the client is, and acknowledged in time and at minimum cost."""

from __future__ import annotations

from typing import Any

import pytest
from aioquic.quic.connection import QuicConnection
from aioquic.tls import Epoch

from tests.render.transport.simulated import CLIENT, DELAY, Simulation, frames
from tigas_render.transport.aioquic_ext import receiving

SETTLED = 5.0
"""Seconds after which a new connection is quiet."""
OTHER_PORT, OTHER_HOST = ("192.0.2.1", 1001), ("198.51.100.1", 1000)
INITIAL_WINDOW = 10 * 1452


@pytest.fixture
def settled() -> Simulation:
    simulation = Simulation()
    simulation.open()
    simulation.run(until=SETTLED)
    simulation.sent.clear()
    return simulation


def from_server(simulation: Simulation) -> list[tuple[float, int]]:
    """When it sent how much, since it had the request."""
    return [(time - SETTLED - DELAY, size) for time, sender, size in simulation.sent if sender == "server"]


def test_a_frame_takes_the_acknowledgement_along(settled: Simulation) -> None:
    stream_id = settled.open(300)
    settled.run(until=SETTLED + DELAY + 0.005)
    assert from_server(settled) == []
    settled.server.send_stream_data(stream_id, bytes(5000), end_stream=True)
    settled.run(until=SETTLED + 2 * DELAY + 0.015)
    assert [size > 500 for _, size in from_server(settled)] == [True] * 4
    assert not settled.client._loss.spaces[-1].ack_eliciting_in_flight


@pytest.mark.parametrize(
    ("sizes", "lost", "earliest", "latest"),
    [((300,), False, 0.010, 0.025), ((1200, 1200), False, -0.001, 0.001), ((300, 300), True, -0.001, 0.001)],
    ids=["one: soon", "two: at once", "one after a lost one: at once"],
)
def test_requests_that_are_not_answered_are_acknowledged(
    settled: Simulation, sizes: tuple[int, ...], lost: bool, earliest: float, latest: float
) -> None:
    settled.open(sizes[0])
    if lost:
        settled.client.datagrams_to_send(settled.now)
    for size in sizes[1:]:
        settled.open(size)
    settled.run(until=SETTLED + (DELAY + 0.005 if lost else 1))
    ((time, size),) = from_server(settled)
    assert earliest <= time < latest
    assert size < 100


def test_duplicates_and_spoilt_datagrams_change_nothing(settled: Simulation) -> None:
    stream_id = settled.open(300)
    ((data, _),) = settled.client.datagrams_to_send(settled.now)
    for each in (data[:-1] + bytes([data[-1] ^ 1]), data[:15], data, data):
        settled.server.receive_datagram(each, CLIENT, settled.now)
    settled._events()
    assert settled.uploads[stream_id] == bytes(300)


def test_new_keys_are_followed(settled: Simulation) -> None:
    settled.client.request_key_update()
    settled.exchange(2)
    settled.server.request_key_update()
    settled.exchange(3)


@pytest.mark.parametrize("packets", [1, 50])
@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_keys_are_renewed_and_the_connection_goes_on(
    settled: Simulation, monkeypatch: pytest.MonkeyPatch, packets: int, loss: float
) -> None:
    monkeypatch.setattr(receiving, "KEY_PACKETS", packets)
    settled.lose(loss)
    keys = set()
    for _ in range(5):
        settled.exchange(3, step=lambda: keys.add(settled.client._cryptos[Epoch.ONE_RTT].recv.secret))
    sent = sum(sender == "server" for _, sender, _ in settled.sent)
    assert 5 <= len(keys) <= 2 + sent / packets


def test_a_request_sent_before_the_client_hears_of_new_keys_arrives(
    settled: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    settled.answer_all(frames(1))
    monkeypatch.setattr(receiving, "KEY_PACKETS", 1)
    before = settled.server._cryptos[Epoch.ONE_RTT].send.secret
    settled._send("server", settled.server)
    assert settled.server._cryptos[Epoch.ONE_RTT].send.secret != before
    stream_id = settled.open(300)
    settled.play(DELAY + 0.001)
    assert settled.uploads[stream_id] == bytes(300)


class Moving(Simulation):
    """A connection with a grown window. `dear` calls are aioquic's own way, several times as slow as ours."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__()
        self.exchange(2)
        self.exchange(2)
        self.window = self.server._loss.congestion_window
        assert self.window > 3 * INITIAL_WINDOW
        self.dear: list[str] = []
        for name in ("receive_datagram", "datagrams_to_send"):
            original = getattr(QuicConnection, name)

            def counted(connection: QuicConnection, *arguments: Any, original: Any = original, **named: Any) -> Any:
                if not connection._is_client:
                    self.dear.append(original.__name__)
                return original(connection, *arguments, **named)

            monkeypatch.setattr(QuicConnection, name, counted)

    def is_settled(self, address: tuple[str, int]) -> None:
        """Check that the client is reached here, and as cheaply as before."""
        self.dear.clear()
        self.exchange(2)
        assert not self.dear
        assert self.server._network_paths[0].addr == address

    def ping(self) -> bytes:
        """A datagram of the client on its way."""
        self.client.send_ping(1)
        ((data, _),) = self.client.datagrams_to_send(self.now)
        return data


@pytest.fixture
def moving(monkeypatch: pytest.MonkeyPatch) -> Moving:
    return Moving(monkeypatch)


def test_another_port_costs_nothing_and_keeps_the_window(moving: Moving) -> None:
    late = moving.ping()
    moving.address = OTHER_PORT
    moving.exchange(2)
    assert moving.server._loss.congestion_window >= moving.window
    moving.is_settled(OTHER_PORT)
    assert len(moving.server._network_paths) == 1
    moving.server.receive_datagram(late, CLIENT, moving.now)  # from the old port
    moving.exchange(2)
    moving.is_settled(OTHER_PORT)


def test_another_address_begins_with_the_initial_window_and_round_trip(moving: Moving) -> None:
    moving.address = OTHER_HOST
    moving.open()
    loss = moving.server._loss
    seen: list[tuple[int, bool]] = []
    moving.run(step=lambda: seen.append((loss.congestion_window, loss._rtt_initialized)))
    assert (INITIAL_WINDOW, False) in seen
    moving.exchange(2)
    assert loss.bytes_in_flight == 0
    moving.is_settled(OTHER_HOST)
    assert len(moving.server._network_paths) == 1


def test_a_packet_from_elsewhere_moves_nobody_for_long(moving: Moving) -> None:
    """An attacker on the path sends a copy of a packet from another address, and it overtakes the original."""
    moving.server.receive_datagram(moving.ping(), OTHER_HOST, moving.now)
    moving.exchange(2)
    moving.exchange(2)
    assert moving.server._loss.congestion_window >= moving.window
    moving.is_settled(CLIENT)
