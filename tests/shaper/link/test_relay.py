"""The delay line, with time and chance as the test wants them."""

from __future__ import annotations

import random

import pytest

from tigas_shaper.link.relay import MAX_HELD_BYTES, DelayLine, RelayState


def leave_times(line: DelayLine, until: float) -> list[tuple[bytes, float]]:
    left = []
    while line.next_due is not None and line.next_due <= until:
        now = line.next_due
        assert line.pop(now - 1e-9) is None
        packet = line.pop(now)
        assert packet is not None
        left.append((packet, now))
    return left


def test_packets_leave_after_the_delay() -> None:
    line = DelayLine(random.uniform)
    line.state = RelayState(delay_s=0.05)
    line.push(b"a", 1.0)
    line.push(b"b", 1.01)
    packets, times = zip(*leave_times(line, 9), strict=True)
    assert packets == (b"a", b"b")
    assert times == pytest.approx((1.05, 1.06))
    assert line.next_due is None


def test_jitter_is_uniform_around_the_delay_and_never_reorders() -> None:
    chance = random.Random(1)
    line = DelayLine(chance.uniform)
    line.state = RelayState(delay_s=0.05, jitter_s=0.02)
    for number in range(2000):
        line.push(number.to_bytes(2, "big"), number)  # so far apart that none waits for another
    delays = [at - number for number, (_, at) in enumerate(leave_times(line, 1e9))]
    assert 0.03 <= min(delays) < 0.031
    assert 0.069 < max(delays) <= 0.07
    assert sum(delays) / 2000 == pytest.approx(0.05, abs=0.001)
    for number in range(2000):
        line.push(number.to_bytes(2, "big"), number * 1e-3)
    assert [int.from_bytes(packet, "big") for packet, _ in leave_times(line, 1e9)] == list(range(2000))


def test_a_jitter_larger_than_the_delay_sends_nothing_into_the_past() -> None:
    line = DelayLine(lambda low, high: low)
    line.state = RelayState(delay_s=0.01, jitter_s=0.05)
    line.push(b"a", 1.0)
    assert line.next_due == 1.0


def test_a_delay_that_shrinks_keeps_the_order() -> None:
    line = DelayLine(random.uniform)
    line.state = RelayState(delay_s=1.0)
    line.push(b"slow", 0.0)
    line.state = RelayState(delay_s=0.0)
    line.push(b"fast", 0.1)
    assert leave_times(line, 9) == [(b"slow", 1.0), (b"fast", 1.0)]


def test_loss_drops_its_share() -> None:
    chance = random.Random(2)
    line = DelayLine(chance.uniform)
    line.state = RelayState(loss=0.25)
    for _ in range(4000):
        line.push(b"x", 0.0)
    assert len(leave_times(line, 1)) == pytest.approx(3000, abs=100)
    line.state = RelayState(loss=1.0)
    line.push(b"x", 0.0)
    assert line.next_due is None


def test_memory_is_bounded() -> None:
    line = DelayLine(random.uniform)
    line.state = RelayState(delay_s=60)
    packet = bytes(MAX_HELD_BYTES // 4)
    for _ in range(6):
        line.push(packet, 0.0)
    assert len(leave_times(line, 99)) == 4
    line.push(packet, 100.0)
    assert line.next_due == 160.0


def test_states_travel_through_the_pipe() -> None:
    state = RelayState(0.125, 0.0625, 0.5, True)
    assert RelayState.unpack(state.pack()) == state
