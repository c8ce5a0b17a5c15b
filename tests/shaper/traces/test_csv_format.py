"""Our own CSV: its meaning, and round trips."""

from __future__ import annotations

from contextlib import suppress

from hypothesis import given
from hypothesis import strategies as st

from tests.shaper.traces.recordings import HEADER
from tigas_common.wire.shaper import MAX_DURATION_MS, LinkSetting
from tigas_shaper.traces.csv_format import format_csv, parse_csv
from tigas_shaper.traces.trace import NetworkTrace, TraceError


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
