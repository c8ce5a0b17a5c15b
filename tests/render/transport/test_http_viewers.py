"""Who may ask by POST while the server is full."""

from __future__ import annotations

import pytest

from tigas_common.errors import ServerFull
from tigas_render.transport.http_viewers import STAY_S, HttpViewers
from tigas_render.transport.load import Load


class FullLoad(Load):
    """Full when the test says so."""

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
