"""One number a line: packet times or rates."""

from __future__ import annotations

import pytest

from tests.shaper.traces.recordings import assert_refused, down, read
from tigas_shaper.traces.formats import parse_trace
from tigas_shaper.traces.trace import TraceError


def test_mahimahi_counts_1500_byte_packets_in_bins_of_100_ms() -> None:
    trace = read("0\n5\n99\n100\n250\n250\n")
    assert (trace.times_ms, trace.duration_ms) == ((0, 100, 200), 250)
    # 3, 1 and 2 packets of 12 000 bit, the last bin being 50 ms long
    assert down(trace) == [360, 120, 480]


def test_a_mahimahi_pattern_shorter_than_a_bin_is_its_mean_rate() -> None:
    trace = read("1\n")
    assert (down(trace), trace.duration_ms) == ([12_000], 100)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("0\n0\n", "Line 2: a Mahimahi trace must end after 0 ms."),
        ("1\n1.5\n", "Line 2: a Mahimahi trace holds whole milliseconds, not 1.5."),
        ("1\n9999999999\n", "Line 2: a trace may last 30 days"),
    ],
)
def test_packet_times_that_cannot_be_are_refused(text: str, sentence: str) -> None:
    with pytest.raises(TraceError) as error:
        parse_trace("t", text.encode(), format="mahimahi")
    assert sentence in error.value.detail


def test_a_plain_list_is_one_rate_a_second() -> None:
    trace = read("5000\n2500.5\n0\n")
    assert (trace.times_ms, trace.duration_ms, down(trace)) == ((0, 1000, 2000), 3000, [5000, 2500.5, 0])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("hello\n", "Line 1: each line of this file must be a number, not 'hello'."),
        ("5000\nfast\n", "Line 2: each line of this file must be a number, not 'fast'."),
        ("5000\n-1\n", "Line 2: each line of this file must not be negative"),
        ("5000\nnan\n", "Line 2: each line of this file must be a number, not 'nan'."),
        ("5000\n1e999\n", "Line 2: each line of this file is too large"),
        ("9" * 9_000 + "\n", "Line 1: each line of this file must be a number"),
        ("".join(f"{stamp}\n" for stamp in (*range(50), 20, *range(50, 60))), "Line 51: time must not go back"),
    ],
)
def test_what_is_broken_is_refused_with_one_sentence(text: str, sentence: str) -> None:
    assert_refused(text, sentence)
