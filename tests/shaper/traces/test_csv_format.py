"""Our own CSV: its meaning, round trips, and faults named by line."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tigas_common.wire.shaper import MAX_DURATION_MS, LinkSetting
from tigas_shaper.traces.csv_format import format_csv, parse_csv
from tigas_shaper.traces.trace import NetworkTrace, TraceError

HEADER = "t_ms,down_kbps,up_kbps,delay_ms,jitter_ms,loss_pct\n"


def test_an_empty_cell_means_as_before_and_a_last_line_of_only_a_time_is_the_end() -> None:
    trace = parse_csv("t", HEADER + "0,5000,1000,20,,\n500,0,,,2.5,\n800,,,40,,1\n1000,,,,,\n")
    assert trace == NetworkTrace(
        "t",
        (0, 500, 800),
        (LinkSetting(5000, 1000, 20), LinkSetting(0, 1000, 20, 2.5), LinkSetting(0, 1000, 40, 2.5, 1)),
        1000,
    )


def test_without_an_end_the_last_state_lasts_as_long_as_the_one_before() -> None:
    assert parse_csv("t", "t_ms,down_kbps\n0,1\n200,2\n700,3\n").duration_ms == 1200
    assert parse_csv("t", "t_ms,down_kbps\n0,1\n").duration_ms == 1000


def test_columns_may_be_absent_and_in_any_order() -> None:
    trace = parse_csv("t", "down_kbps,t_ms\n5000,0\n")
    assert trace.states == (LinkSetting(5000, 10_000, 0, 0, 0),)
    assert parse_csv("t", "t_ms,down_kbps\n0,1\n", up_kbps=77).states[0].up_kbps == 77


def test_windows_line_ends_blank_lines_spaces_and_quotes_are_taken_as_meant() -> None:
    trace = parse_csv("t", '\r\nt_ms, down_kbps\r\n"0", 5\r\n\r\n100, 6\r\n')
    assert (trace.times_ms, [state.down_kbps for state in trace.states]) == ((0, 100), [5, 6])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("t_ms,up_kbps\n0,1\n", "Line 1: the header lacks down_kbps."),
        ("t_ms,down_kbps,rtt\n0,1,2\n", "Line 1: 'rtt' is not a column"),
        ("t_ms,down_kbps,down_kbps\n0,1,2\n", "Line 1: the header has down_kbps twice."),
        ("t_ms,down_kbps\n", "a header and no line after it"),
        ("t_ms,down_kbps\n5,1\n", "Line 2: the first t_ms must be 0, not 5."),
        ("t_ms,down_kbps\n0,1\n100,2\n100,3\n", "Line 4: t_ms must rise, but 100 comes after 100."),
        ("t_ms,down_kbps\n0,1\n100,2\n50,3\n", "Line 4: t_ms must rise, but 50 comes after 100."),
        ("t_ms,down_kbps\n0,1\n1.5,2\n", "Line 3: t_ms must be whole milliseconds from 0, not '1.5'."),
        ("t_ms,down_kbps\n0,1\n-5,2\n", "Line 3: t_ms must be whole milliseconds"),
        ("t_ms,down_kbps\n0,1\n,2\n", "Line 3: t_ms must be whole milliseconds from 0, not ''."),
        ("t_ms,down_kbps\n0,\n", "Line 2: the first line must give down_kbps."),
        ("t_ms,down_kbps\n0,fast\n", "Line 2: down_kbps must be a number, not 'fast'."),
        ("t_ms,down_kbps\n0,nan\n", "Line 2: down_kbps must be a number, not 'nan'."),
        ("t_ms,down_kbps\n0,inf\n", "Line 2: down_kbps must be a number, not 'inf'."),
        ("t_ms,down_kbps\n0,1e999\n", "Line 2: down_kbps is too large"),
        ("t_ms,down_kbps\n0,1_000\n", "Line 2: down_kbps must be a number"),
        ("t_ms,down_kbps\n0,٣\n", "Line 2: down_kbps must be a number"),
        ("t_ms,down_kbps\n0,-1\n", "Line 2: down_kbps must not be negative"),
        ("t_ms,down_kbps\n0,2e8\n", "Line 2: down_kbps: input should be less than or equal to 100000000."),
        (HEADER + "0,1,1,0,0,101\n", "Line 2: loss_pct: input should be less than or equal to 100."),
        ("t_ms,down_kbps\n0,1,2\n", "Line 2: 2 cells are expected, not 3."),
        ("t_ms,down_kbps\n0\n", "Line 2: 2 cells are expected, not 1."),
        ('t_ms,down_kbps\n0,"1\n', "Line 2: 2 cells are expected, not 1."),
        ("t_ms,down_kbps\n0,1\n9999999999999,2\n", "a trace may last 30 days"),
    ],
)
def test_a_fault_is_named_by_its_line(text: str, sentence: str) -> None:
    with pytest.raises(TraceError) as error:
        parse_csv("t", text)
    assert sentence in error.value.detail
    assert "\n" not in error.value.detail


rates = st.floats(0, 1e8)
states = st.builds(LinkSetting, rates, rates, st.floats(0, 60_000), st.floats(0, 60_000), st.floats(0, 100))


@st.composite
def traces(draw: st.DrawFn) -> NetworkTrace:
    times = [0, *sorted(draw(st.sets(st.integers(1, MAX_DURATION_MS - 1), max_size=8)))]
    # few different states, so that equal neighbours, with only empty cells, occur
    pool = draw(st.lists(states, min_size=1, max_size=3))
    chosen = draw(st.lists(st.sampled_from(pool), min_size=len(times), max_size=len(times)))
    return NetworkTrace("t", tuple(times), tuple(chosen), draw(st.integers(times[-1] + 1, MAX_DURATION_MS)))


@given(traces())
def test_writing_and_reading_gives_the_same_trace(trace: NetworkTrace) -> None:
    assert parse_csv("t", format_csv(trace)) == trace


@given(st.text(max_size=60).map(lambda text: HEADER + text))
def test_whatever_follows_the_header_is_read_or_refused(text: str) -> None:
    with suppress(TraceError):
        assert parse_csv("t", text).duration_ms > 0
