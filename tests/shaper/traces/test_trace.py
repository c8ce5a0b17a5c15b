"""Traces: states over time, looping, statistics, and strict bounds; and their making from states."""

from __future__ import annotations

import pytest

from tests.shaper.traces.recordings import read
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.trace import NetworkTrace, TraceError, rate_percentiles

FAST, SLOW = LinkSetting(20_000, 5_000), LinkSetting(0, 1_000, 20, 5, 1.5)


def test_a_state_holds_until_the_next_and_the_trace_starts_again_at_its_end() -> None:
    trace = NetworkTrace("t", (0, 100), (FAST, SLOW), 400)
    assert all(trace.state_at(t) is FAST for t in (0, 99.9, 400, 4099))
    assert all(trace.state_at(t) is SLOW for t in (100, 399.9, 4100))
    assert trace.steps_ms == (100, 300)


def test_means_and_percentiles_are_weighted_by_time() -> None:
    trace = NetworkTrace("t", (0, 100), (FAST, SLOW), 400)
    assert trace.mean_down_kbps == 5_000
    assert trace.mean_up_kbps == 2_000
    assert rate_percentiles([30, 10, 20], [100, 800, 100]) == {5: 10, 25: 10, 50: 10, 75: 10, 95: 30}


def test_neighbouring_steps_at_0_are_one_outage() -> None:
    up, off = LinkSetting(1, 1), LinkSetting(0, 1)
    trace = NetworkTrace("t", (0, 10, 20, 50, 60), (off, off, up, up, off), 100)
    assert trace.outages == [(0, 20), (60, 40)]


def test_two_directions_become_one_trace_and_the_shorter_uplink_repeats() -> None:
    both = read("5000\n4000\n").with_uplink(read("1000\n2000\n0\n"))
    assert [(state.down_kbps, state.up_kbps) for state in both.states] == [(5000, 1000), (4000, 2000)]
    up = NetworkTrace("up", (0, 400), (LinkSetting(1, 9), LinkSetting(2, 9)), 700)
    both = read("5000\n4000\n3000\n").with_uplink(up)
    assert both.times_ms == (0, 400, 700, 1000, 1100, 1400, 1800, 2000, 2100, 2500, 2800)
    assert [state.up_kbps for state in both.states] == [1, 2, 1, 1, 2, 1, 2, 2, 1, 2, 1]
    assert both.duration_ms == 3000


def test_too_many_steps_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tigas_shaper.traces.trace.MAX_STEPS", 1_000)
    with pytest.raises(TraceError, match="Line 1001: a trace may have 1,000 steps"):
        read("70000\n30000.5\n" * 600)
    hasty = NetworkTrace("up", (0, 1), (LinkSetting(1, 1), LinkSetting(2, 1)), 2)
    with pytest.raises(TraceError, match="1,000 steps"):
        NetworkTrace("t", (0,), (LinkSetting(1, 1),), 300_000).with_uplink(hasty)
    with pytest.raises(TraceError, match="1,000 steps; this one has 1,001"):
        NetworkTrace("t", tuple(range(1001)), (FAST,) * 1001, 1001)


def test_parts_of_milliseconds_add_up_and_do_not_drift() -> None:
    trace = read("".join(f"{line * 0.2504:.4f} 1\n" for line in range(11)))
    assert trace.times_ms[:4] == (0, 250, 501, 751)
    assert trace.duration_ms == 2504


@pytest.mark.parametrize(
    ("times", "duration", "sentence"),
    [
        ((), 100, "at least one step"),
        ((10,), 100, "starts at 0 ms, not at 10"),
        ((0, 50, 50), 100, "50 ms comes after 50 ms"),
        ((0, 50, 20), 100, "20 ms comes after 50 ms"),
        ((0, 50), 50, "50 ms comes after 50 ms"),
        ((0,), 10**12, "30 days"),
    ],
)
def test_times_start_at_0_rise_and_end(times: tuple[int, ...], duration: int, sentence: str) -> None:
    with pytest.raises(TraceError, match=sentence):
        NetworkTrace("t", times, (FAST,) * len(times), duration)


def test_there_is_one_state_a_time() -> None:
    with pytest.raises(TraceError, match="one state for each time"):
        NetworkTrace("t", (0, 1), (FAST,), 100)


@pytest.mark.parametrize("name", ["", "../etc", "a/b", "a b", ".hidden", "é", "x" * 101, "a\n"])
def test_a_name_is_safe_as_a_file_and_in_a_url(name: str) -> None:
    with pytest.raises(TraceError, match="name"):
        NetworkTrace(name, (0,), (FAST,), 100)
