"""Ghent's logs: bytes over intervals."""

from __future__ import annotations

import pytest

from tests.shaper.traces.recordings import GHENT, assert_refused, down, read


def test_ghent_counts_bytes_and_states_last_as_long_as_their_interval() -> None:
    trace = read(GHENT)
    assert trace.times_ms == (0, 725)
    assert trace.duration_ms == 1725
    assert down(trace) == pytest.approx([3263799 * 8 / 725, 33809.92])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (GHENT + "1 2 3\n", "Line 3: a Ghent 4G log has 6 columns, not 3."),
        (GHENT + "1 900 51 3 5 1000\n", "Line 3: time must not go back, but 900 ms comes after 1725 ms."),
        (GHENT + "1 2725 51 3 5 0\n", "Line 3: the interval must not be 0 ms."),
        (GHENT + "1 2725 51 3 inf 1000\n", "Line 3: the bytes must be a number, not 'inf'."),
    ],
)
def test_what_is_broken_is_refused_with_one_sentence(text: str, sentence: str) -> None:
    assert_refused(text, sentence)
