"""Commands to tc when a direction of the link changes."""

from __future__ import annotations

import pytest

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.link.direction import MIN_QUEUE, Direction, queue_bytes, queue_line, rate_line
from tigas_shaper.link.interfaces import Interface

DEVICE = Interface("tigas-down")


class Told:
    """In place of tc and of the delay stage: records its commands."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def write(self, *lines: str) -> None:
        self.lines += lines

    def set(self, state: LinkSetting, *, blocked: bool) -> None:
        self.lines.append(f"delay {state.delay_ms:g} {state.jitter_ms:g} {state.loss_pct:g} {blocked}")

    def since(self) -> list[str]:
        """Commands since the last call."""
        lines, self.lines = self.lines, []
        return lines


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


def test_only_what_changes_is_told() -> None:
    told = Told()
    direction = Direction(told, DEVICE, Interface("lo"), told, queue_ms=150)  # type: ignore[arg-type]
    state = LinkSetting(down_kbps=20_000, up_kbps=1_000, delay_ms=5)
    direction.shape(state, state.down_kbps, 10_000)
    assert told.since() == [
        "delay 5 0 0 False",
        rate_line("change", DEVICE, 20_000),
        queue_line("change", DEVICE, 187_500, 1e7),
    ]
    direction.shape(state, state.down_kbps, None)
    assert told.since() == []
    direction.shape(state, 8_000, 10_000)
    assert told.since() == [rate_line("change", DEVICE, 8_000)]


def test_an_outage_slows_the_leaf_and_keeps_its_queue_and_its_rate() -> None:
    told = Told()
    direction = Direction(told, DEVICE, Interface("lo"), told, queue_ms=150)  # type: ignore[arg-type]
    on, off = LinkSetting(1_000, 1_000), LinkSetting(0, 0)
    direction.shape(on, 1_000, 1_000)
    told.since()
    direction.shape(off, 0, None)
    delay, queue = told.since()
    assert delay == "delay 0 0 0 True"
    assert queue.endswith("tbf rate 50kbit burst 3028b limit 18750b")
    direction.shape(on, 1_000, None)
    delay, queue = told.since()
    assert delay == "delay 0 0 0 False"
    assert queue.endswith("tbf rate 10000000kbit burst 3028b limit 18750b")
