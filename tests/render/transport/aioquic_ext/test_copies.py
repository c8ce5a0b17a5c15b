"""Frames on a path that loses packets at random are sent twice, so that they need not wait for a retransmission."""

from __future__ import annotations

import random

import pytest

from tests.render.transport.simulated import DELAY, Simulation, frames
from tigas_render.transport.aioquic_ext.congestion import RENO
from tigas_render.transport.aioquic_ext.westwood import WESTWOOD

INTERVAL = 1 / 30
SIZE = 20_000


def warmed_up(congestion_control: str) -> Simulation:
    """A connection with a window of a few frames."""
    simulation = Simulation(congestion_control=congestion_control)
    simulation.exchange()
    return simulation


def lose_frames(simulation: Simulation, share: float) -> None:
    """Lose this share of the server's datagrams, the full ones, from now on."""
    generator = random.Random(7)
    simulation.drop = lambda sender, data: sender == "server" and len(data) > 1000 and generator.random() < share


def late_share(simulation: Simulation, count: int = 200) -> float:
    """Send frames at a fixed rate; the share that needs more than half a round trip beyond its way."""
    late = 0
    before = len(simulation.ended)
    for body in frames(count, SIZE):
        stream_id, begun = simulation.open(), simulation.now
        while stream_id not in simulation.server._streams:
            simulation.play(0.001)
        simulation.server.send_stream_data(stream_id, body, end_stream=True)
        simulation.play(2 * DELAY)
        late += stream_id not in simulation.ended
        simulation.play(max(0.0, begun + 2 * INTERVAL - simulation.now))
        assert bytes(simulation.streams[stream_id]) in (body, body[: len(simulation.streams[stream_id])])
    simulation.run()
    assert len(simulation.ended) == before + count
    return late / count


def test_few_frames_wait_for_a_retransmission() -> None:
    late = {}
    for name in (RENO, WESTWOOD):
        simulation = warmed_up(name)
        lose_frames(simulation, 0.02)
        late[name] = late_share(simulation)
    assert late[RENO] > 0.15
    assert late[WESTWOOD] < 0.04


def test_without_loss_nothing_is_sent_twice() -> None:
    simulation = warmed_up(WESTWOOD)
    before = len(simulation.sent)
    assert late_share(simulation, 50) == 0
    assert sum(size for _, sender, size in simulation.sent[before:] if sender == "server") < 1.1 * 50 * SIZE


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_answers_are_whole_whatever_is_lost(share: float) -> None:
    simulation = Simulation(congestion_control=WESTWOOD)
    simulation.lose(share)
    for _ in range(20):
        simulation.exchange(count=3, size=30_000)
    simulation.drop = lambda sender, data: False
    simulation.exchange(count=3)


def test_a_cancelled_answer_is_not_copied() -> None:
    simulation = Simulation(congestion_control=WESTWOOD)
    lose_frames(simulation, 0.05)
    late_share(simulation, 20)
    (stream_id,) = simulation.answer_all(frames(1))
    simulation.play(DELAY / 2)
    simulation.server.reset_stream(stream_id, 1)
    sent = len(simulation.sent)
    simulation.run()
    assert sum(size for _, sender, size in simulation.sent[sent:] if sender == "server") < 5000
    simulation.exchange()
