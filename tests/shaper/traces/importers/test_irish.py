"""The 5G set of Cork: seconds that repeat, skip, or were not measured."""

from __future__ import annotations

import pytest

from tests.shaper.traces.recordings import IRISH, assert_refused, down, read


def test_irish_rows_of_one_second_are_averaged_gaps_hold_and_uplink_traffic_is_no_capacity() -> None:
    trace = read(IRISH)
    assert (trace.times_ms, trace.duration_ms) == ((0, 1000, 5000), 6000)
    assert down(trace) == [200, 200, 50]
    assert {state.up_kbps for state in trace.states} == {10_000}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (IRISH + "2019.12.16_14.23.31,1,1,1,1\n", "Line 7: time must not go back"),
        (IRISH + "yesterday,1,1,1,1\n", "Line 7: Timestamp must look like"),
        (IRISH + "2019.12.16_14.23.38,1\n", "Line 7: 5 cells are expected, not 2."),
        (IRISH + "2019.12.16_14.23.38,1,1,x,1\n", "Line 7: DL_bitrate must be a number, not 'x'."),
        (IRISH + '2019.12.16_14.23.38,"1,1,x,1\n', "Line 7: the quotes do not match."),
        ("Timestamp,DL_bitrate\n2019.12.16_14.23.38,-\n", "No row has a DL_bitrate."),
        ("Time,DL_bitrate\n1,2\n", "Line 1: the header lacks Timestamp."),
    ],
)
def test_what_is_broken_is_refused_with_one_sentence(text: str, sentence: str) -> None:
    assert_refused(text, sentence)
