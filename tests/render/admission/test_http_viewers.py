"""Admission of clients by POST while the server is full."""

from __future__ import annotations

import pytest

from tigas_common.errors import ServerFull
from tigas_render.admission.http_viewers import MOST_NAMED, STAY_S, HttpViewers
from tigas_render.admission.load import Load


class FullLoad(Load):
    """A load controlled by the test."""

    is_full = False

    def full(self) -> float | None:
        return 5.0 if self.is_full else None


def test_who_is_in_goes_on_and_others_are_told_when_to_come_back() -> None:
    now = 100.0
    load = FullLoad()
    viewers = HttpViewers(load, lambda: now)
    viewers.check("192.0.2.1")
    load.is_full = True
    with pytest.raises(ServerFull) as refused:
        viewers.check("192.0.2.2")
    assert refused.value.retry_after_s == 5.0
    for _ in range(3):
        now += STAY_S - 1
        viewers.check("192.0.2.1")
    now += STAY_S + 1
    with pytest.raises(ServerFull):
        viewers.check("192.0.2.1")
    assert load.state.viewers == 0
    assert load.state.refused == 2
    load.is_full = False
    viewers.check("192.0.2.2")
    assert load.state.viewers == 1


def test_who_comes_behind_a_gateway_is_refused_as_others_are() -> None:
    load = FullLoad()
    viewers = HttpViewers(load, lambda: 0.0)
    viewers.check("192.0.2.1", "first")
    load.is_full = True
    viewers.check("192.0.2.1", "first")
    for name in ("second", ""):
        with pytest.raises(ServerFull):
            viewers.check("192.0.2.1", name)
    assert load.state.viewers == 1


def test_an_address_has_only_so_many_viewers_whatever_it_calls_them() -> None:
    now = 0.0
    load = FullLoad()
    viewers = HttpViewers(load, lambda: now)
    for number in range(3 * MOST_NAMED):
        viewers.check("192.0.2.1", str(number))
    assert load.state.viewers == MOST_NAMED + 1
    viewers.check("192.0.2.2", "0")
    now += STAY_S + 1
    viewers.check("192.0.2.2", "0")
    assert load.state.viewers == 1
    viewers.check("192.0.2.1", "one more")
    assert load.state.viewers == 2
