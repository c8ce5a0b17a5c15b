"""Traces: states over time, looping, and strict bounds."""

from __future__ import annotations

import pytest

from tigas_common.errors import problem
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.trace import MAX_STEPS, NetworkTrace, TraceError

FAST, SLOW = LinkSetting(20_000, 5_000), LinkSetting(0, 1_000, 20, 5, 1.5)


def test_a_state_holds_until_the_next_and_the_trace_starts_again_at_its_end() -> None:
    trace = NetworkTrace("t", (0, 100), (FAST, SLOW), 400)
    assert [trace.at(t) for t in (0, 99.9, 100, 399.9, 400, 4099, 4100)] == [
        FAST,
        FAST,
        SLOW,
        SLOW,
        FAST,
        FAST,
        SLOW,
    ]
    assert trace.steps_ms == (100, 300)


def test_means_are_weighted_by_time() -> None:
    trace = NetworkTrace("t", (0, 100), (FAST, SLOW), 400)
    assert trace.mean_down_kbps == 5_000
    assert trace.mean_up_kbps == 2_000


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


def test_there_is_one_state_a_time_and_a_limit_to_both() -> None:
    with pytest.raises(TraceError, match="one state a time"):
        NetworkTrace("t", (0, 1), (FAST,), 100)
    steps = MAX_STEPS + 1
    with pytest.raises(TraceError, match="250,000 steps"):
        NetworkTrace("t", tuple(range(steps)), (FAST,) * steps, steps)


@pytest.mark.parametrize("name", ["", "../etc", "a/b", "a b", ".hidden", "é", "x" * 101, "a\n"])
def test_a_name_is_safe_as_a_file_and_in_a_url(name: str) -> None:
    with pytest.raises(TraceError, match="name"):
        NetworkTrace(name, (0,), (FAST,), 100)


def test_a_broken_trace_is_answered_with_422() -> None:
    answer = problem(TraceError("Line 3: no."))
    assert (answer.status, answer.type, answer.detail) == (422, "tigas:broken-trace", "Line 3: no.")
