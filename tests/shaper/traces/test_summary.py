"""Statistics are of time, not of lines."""

from __future__ import annotations

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.summary import outages, rate_summary
from tigas_shaper.traces.trace import NetworkTrace


def test_percentiles_and_mean_are_weighted_by_time() -> None:
    summary = rate_summary([30, 10, 20], [100, 800, 100])
    assert (summary.mean, summary.minimum, summary.maximum) == (13, 10, 30)
    assert summary.percentiles == {5: 10, 25: 10, 50: 10, 75: 10, 95: 30}


def test_neighbouring_steps_at_0_are_one_outage() -> None:
    up, off = LinkSetting(1, 1), LinkSetting(0, 1)
    trace = NetworkTrace("t", (0, 10, 20, 50, 60), (off, off, up, up, off), 100)
    assert outages(trace) == [(0, 20), (60, 40)]
