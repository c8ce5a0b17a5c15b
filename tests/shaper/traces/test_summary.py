"""Statistics are of time, not of lines."""

from __future__ import annotations

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.summary import outages, rate_percentiles
from tigas_shaper.traces.trace import NetworkTrace


def test_percentiles_are_weighted_by_time() -> None:
    assert rate_percentiles([30, 10, 20], [100, 800, 100]) == {5: 10, 25: 10, 50: 10, 75: 10, 95: 30}


def test_neighbouring_steps_at_0_are_one_outage() -> None:
    up, off = LinkSetting(1, 1), LinkSetting(0, 1)
    trace = NetworkTrace("t", (0, 10, 20, 50, 60), (off, off, up, up, off), 100)
    assert outages(trace) == [(0, 20), (60, 40)]
