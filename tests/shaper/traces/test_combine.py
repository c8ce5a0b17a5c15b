"""Two directions become one trace."""

from __future__ import annotations

import pytest

from tests.shaper.traces.recordings import read
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces import combine as combine_module
from tigas_shaper.traces.combine import combine
from tigas_shaper.traces.trace import NetworkTrace, TraceError


def test_two_directions_become_one_trace_and_the_shorter_uplink_repeats() -> None:
    both = combine(read("5000\n4000\n"), read("1000\n2000\n0\n"))
    assert [(state.down_kbps, state.up_kbps) for state in both.states] == [(5000, 1000), (4000, 2000)]
    both = combine(
        read("5000\n4000\n3000\n"), NetworkTrace("up", (0, 400), (LinkSetting(1, 9), LinkSetting(2, 9)), 700)
    )
    assert both.times_ms == (0, 400, 700, 1000, 1100, 1400, 1800, 2000, 2100, 2500, 2800)
    assert [state.up_kbps for state in both.states] == [1, 2, 1, 1, 2, 1, 2, 2, 1, 2, 1]
    assert both.duration_ms == 3000


def test_directions_that_change_too_often_together_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(combine_module, "MAX_STEPS", 1_000)
    hasty = NetworkTrace("up", (0, 1), (LinkSetting(1, 1), LinkSetting(2, 1)), 2)
    with pytest.raises(TraceError, match="1,000 steps"):
        combine(NetworkTrace("t", (0,), (LinkSetting(1, 1),), 300_000), hasty)
