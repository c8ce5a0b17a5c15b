"""Limits enforced by each of several edges."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from tigas_common.limits import HttpLimits
from tigas_render.admission.limits import Limits

TRIALS = 2000


@pytest.mark.parametrize("edges", [6, 12])
def test_as_many_viewers_of_one_address_get_in_as_the_limit_says_wherever_they_fall(edges: int) -> None:
    limits, of_each = Limits(), Limits().of_each(edges)
    generator = random.Random(2)
    for name in ("connections_per_address", "sessions_per_address"):
        viewers, most = getattr(limits, name), getattr(of_each, name)
        all_in = sum(
            max(Counter(generator.randrange(256) % edges for _ in range(viewers)).values()) <= most
            for _ in range(TRIALS)
        )
        assert all_in >= 0.99 * TRIALS
        assert most * edges <= 2.5 * viewers


def test_a_single_process_enforces_the_limits_as_they_are() -> None:
    assert Limits().of_each(1) == Limits()
    assert HttpLimits().per_process(1) == HttpLimits()


def test_no_edge_takes_more_than_all_may_together() -> None:
    assert Limits(connections_per_address=1).of_each(6).connections_per_address == 1
    assert HttpLimits(connections=2).per_process(6).connections == 2
