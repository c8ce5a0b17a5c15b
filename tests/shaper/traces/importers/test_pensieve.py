"""Lines of "seconds Mbit/s"."""

from __future__ import annotations

import pytest

from tests.shaper.traces.recordings import assert_refused, down, read


def test_a_pensieve_rate_holds_up_to_the_time_on_its_line() -> None:
    trace = read("0.0 9\n0.5 1.5\n2.0 3\n")
    assert (trace.times_ms, trace.duration_ms, down(trace)) == ((0, 500), 2000, [1500, 3000])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("0 1\n1 2 3\n", "Line 2: two columns are expected"),
        ("0 1\n2 2\n1 2\n", "Line 3: time must rise, but 1 s comes after 2 s."),
    ],
)
def test_what_is_broken_is_refused_with_one_sentence(text: str, sentence: str) -> None:
    assert_refused(text, sentence)
