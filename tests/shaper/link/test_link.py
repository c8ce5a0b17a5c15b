"""Commands to tc when the link changes. (Both backends are tested in the namespaces.)"""

from __future__ import annotations

import pytest

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.link.commands import Interface
from tigas_shaper.link.delay import NetemStage
from tigas_shaper.link.link import MIN_QUEUE, Direction, queue_bytes, queue_line, rate_line

DEVICE = Interface("tigas-down")


class Recorder:
    """In place of tc and of the delay stage."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def write(self, *lines: str) -> None:
        self._lines += lines

    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        self.write(f"delay {state.delay_ms:g} {state.jitter_ms:g} {state.loss_pct:g} {blocked}")

    def take(self) -> list[str]:
        """Commands since the last call."""
        lines, self._lines = self._lines, []
        return lines


@pytest.fixture
def tc() -> Recorder:
    return Recorder()


@pytest.fixture
def direction(tc: Recorder) -> Direction:
    return Direction(tc, DEVICE, Interface("lo"), tc, queue_ms=150)  # type: ignore[arg-type]


def test_a_queue_takes_its_time_to_drain() -> None:
    assert queue_bytes(20_000, 150) == 375_000
    assert queue_bytes(10, 150) == MIN_QUEUE


@pytest.mark.parametrize(
    ("rate", "bits", "burst"),
    [(20_000, 20_000_000, 3028), (1e6, 10**9, 125_000), (1, 50_000, 3028), (0.5, 50_000, 3028)],
)
def test_rates_are_whole_numbers_and_never_too_low_to_recover_from(rate: float, bits: int, burst: int) -> None:
    line = rate_line("change", DEVICE, rate)
    assert f"rate {bits}bit burst {burst}b cburst {burst}b" in line
    assert line.startswith("class change dev tigas-down ")


def test_only_changes_are_sent(tc: Recorder, direction: Direction) -> None:
    state = LinkSetting(down_kbps=20_000, up_kbps=1_000, delay_ms=5)
    direction.shape(state, state.down_kbps, 10_000)
    assert tc.take() == [
        "delay 5 0 0 False",
        rate_line("change", DEVICE, 20_000),
        queue_line("change", DEVICE, 187_500, 1e7),
    ]
    direction.shape(state, state.down_kbps, None)
    assert tc.take() == []
    direction.shape(state, 8_000, 10_000)
    assert tc.take() == [rate_line("change", DEVICE, 8_000)]


def test_an_outage_slows_the_leaf_and_keeps_its_queue_and_its_rate(tc: Recorder, direction: Direction) -> None:
    on, off = LinkSetting(1_000, 1_000), LinkSetting(0, 0)
    direction.shape(on, 1_000, 1_000)
    tc.take()
    direction.shape(off, 0, None)
    delay, queue = tc.take()
    assert delay == "delay 0 0 0 True"
    assert queue.endswith("tbf rate 50kbit burst 3028b limit 18750b")
    direction.shape(on, 1_000, None)
    delay, queue = tc.take()
    assert delay == "delay 0 0 0 False"
    assert queue.endswith("tbf rate 10000000kbit burst 3028b limit 18750b")


def test_netem_gets_microseconds_keeps_the_order_and_loses_everything_in_an_outage(tc: Recorder) -> None:
    stage = NetemStage(tc, Interface("eth0"))  # type: ignore[arg-type]
    state = LinkSetting(1, 1, delay_ms=12.5, jitter_ms=0.25, loss_pct=1.5)
    stage.set(state, blocked=False)
    stage.set(state, blocked=True)
    change = "qdisc change dev eth0 parent 2:1 handle 20: netem limit 100000 delay 12500us 250us loss {}% rate 100gbit"
    assert tc.take() == [change.format("1.5000"), change.format("100.0000")]
