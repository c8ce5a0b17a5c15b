"""A client that moves to another address is answered there, as cheaply as before, at the speed of the new path."""

from __future__ import annotations

from typing import Any

import pytest
from aioquic.quic.connection import QuicConnection

from tests.render.transport.simulated import CLIENT, Simulation, answer_all, frames

OTHER_PORT, OTHER_HOST = ("192.0.2.1", 1001), ("198.51.100.1", 1000)
INITIAL_WINDOW = 10 * 1452


def with_frames() -> Simulation:
    """A connection with a grown window."""
    simulation = Simulation()
    exchange(simulation)
    exchange(simulation)
    assert simulation.server._loss.congestion_window > 3 * INITIAL_WINDOW
    return simulation


def exchange(simulation: Simulation) -> None:
    """Frames that arrive whole."""
    bodies = frames(2)
    streams = answer_all(simulation, bodies)
    simulation.run()
    assert [bytes(simulation.streams[stream_id]) for stream_id in streams] == bodies


@pytest.fixture
def dear(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The calls of aioquic's own way to receive and to send, which takes several times as long as ours."""
    calls: list[Any] = []
    for name in ("receive_datagram", "datagrams_to_send"):
        original = getattr(QuicConnection, name)

        def counted(self: QuicConnection, *arguments: Any, original: Any = original, **named: Any) -> Any:
            if not self._is_client:
                calls.append(original.__name__)
            return original(self, *arguments, **named)

        monkeypatch.setattr(QuicConnection, name, counted)
    return calls


def test_another_port_costs_nothing_and_keeps_the_window(dear: list[Any]) -> None:
    simulation = with_frames()
    window = simulation.server._loss.congestion_window
    simulation.address = OTHER_PORT
    exchange(simulation)
    assert simulation.server._loss.congestion_window >= window
    dear.clear()
    exchange(simulation)
    assert not dear
    assert [path.addr for path in simulation.server._network_paths] == [OTHER_PORT]


def test_another_address_begins_with_the_initial_window_and_round_trip() -> None:
    simulation = with_frames()
    simulation.address = OTHER_HOST
    simulation.open()
    window, loss = simulation.server._loss.congestion_window, simulation.server._loss
    seen: list[tuple[int, bool]] = []
    simulation.run(step=lambda: seen.append((loss.congestion_window, loss._rtt_initialized)))
    assert (INITIAL_WINDOW, False) in seen
    assert window > INITIAL_WINDOW
    exchange(simulation)
    assert loss.bytes_in_flight == 0
    assert [path.addr for path in simulation.server._network_paths] == [OTHER_HOST]


def test_a_packet_from_elsewhere_moves_nobody_for_long(dear: list[Any]) -> None:
    """An attacker on the path sends a copy of a packet from another address, and it overtakes the original."""
    simulation = with_frames()
    window = simulation.server._loss.congestion_window
    simulation.client.send_ping(1)
    ((data, _),) = simulation.client.datagrams_to_send(simulation.now)
    simulation.server.receive_datagram(data, OTHER_HOST, simulation.now)
    exchange(simulation)
    exchange(simulation)
    assert simulation.server._loss.congestion_window >= window
    dear.clear()
    exchange(simulation)
    assert not dear
    assert simulation.server._network_paths[0].addr == CLIENT


def test_a_late_packet_from_the_old_port_costs_nothing(dear: list[Any]) -> None:
    simulation = with_frames()
    simulation.client.send_ping(1)
    ((late, _),) = simulation.client.datagrams_to_send(simulation.now)
    simulation.address = OTHER_PORT
    exchange(simulation)
    simulation.server.receive_datagram(late, CLIENT, simulation.now)
    exchange(simulation)
    dear.clear()
    exchange(simulation)
    assert not dear
    assert simulation.server._network_paths[0].addr == OTHER_PORT
