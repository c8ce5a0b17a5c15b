"""Patience outlasts a slow link, and neither silence nor a trickle."""

from __future__ import annotations

import itertools

from tigas_common.patience import Patience

SECONDS, RATE = 30.0, 500.0


def survived_s(every_s: float, size: int, until_s: float = 10_000) -> float:
    """Seconds until a sender of this many bytes at this interval times out."""
    patience = Patience(SECONDS, RATE, now=1000.0)
    for part in itertools.count(1):
        now = 1000.0 + part * every_s
        if now >= min(patience.until, 1000.0 + until_s):
            return min(patience.until - 1000.0, until_s)
        patience.progress(size, now)
    raise AssertionError


def test_silence_is_borne_once() -> None:
    assert survived_s(every_s=10_000, size=1) == SECONDS


def test_an_upload_at_50_kbit_per_second_takes_as_long_as_it_needs() -> None:
    assert survived_s(every_s=0.25, size=1500) == 10_000


def test_a_link_that_is_out_for_a_while_is_borne() -> None:
    assert survived_s(every_s=25, size=64_000) == 10_000


def test_a_trickle_is_given_up_although_its_parts_come_in_time() -> None:
    assert survived_s(every_s=1, size=1) < SECONDS + 1
    assert survived_s(every_s=1, size=int(RATE / 2)) < 2 * SECONDS + 2


def test_what_came_fast_buys_no_silence() -> None:
    patience = Patience(SECONDS, RATE, now=0.0)
    patience.progress(100_000_000, now=1.0)
    assert patience.until == 1.0 + SECONDS
