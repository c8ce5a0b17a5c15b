"""The lines for tc."""

from __future__ import annotations

import pytest

from tigas_shaper.link.direction import MIN_QUEUE, Direction, queue_bytes
from tigas_shaper.link.interfaces import Interface

DOWN = Direction(Interface("tigas-down"), Interface("eth0"))


def test_a_queue_takes_its_time_to_drain() -> None:
    assert queue_bytes(20_000, 150) == 375_000
    assert queue_bytes(10, 150) == MIN_QUEUE


@pytest.mark.parametrize(
    ("rate", "bits", "burst"),
    [(20_000, 20_000_000, 3028), (1e6, 10**9, 125_000), (1, 50_000, 3028), (0.5, 50_000, 3028)],
)
def test_rates_are_whole_numbers_and_never_too_low_to_recover_from(rate: float, bits: int, burst: int) -> None:
    line = DOWN.change_rate_line(rate)
    assert f"rate {bits}bit burst {burst}b cburst {burst}b" in line
    assert line.startswith("class change dev tigas-down ")


def test_an_outage_slows_the_leaf_and_keeps_its_queue() -> None:
    assert DOWN.change_queue_line(9000, blocked=True).endswith("tbf rate 50kbit burst 3028b limit 9000b")
    assert DOWN.change_queue_line(9000, blocked=False).endswith("tbf rate 10000000kbit burst 3028b limit 9000b")


def test_netem_gets_microseconds_and_keeps_the_order() -> None:
    line = DOWN.change_netem_line(12.5, 0.25, 1.5)
    assert line == (
        "qdisc change dev eth0 parent 2:1 handle 20: netem limit 100000 delay 12500us 250us loss 1.5000% rate 100gbit"
    )
