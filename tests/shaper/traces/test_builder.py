"""Steps add up to whole milliseconds, within the limits of a trace."""

from __future__ import annotations

import pytest

from tests.shaper.traces.recordings import assert_refused, read
from tigas_shaper.traces import builder
from tigas_shaper.traces.trace import TraceError


def test_parts_of_milliseconds_add_up_and_do_not_drift() -> None:
    trace = read("".join(f"{line * 0.2504:.4f} 1\n" for line in range(11)))
    assert trace.times_ms[:4] == (0, 250, 501, 751)
    assert trace.duration_ms == 2504


def test_too_many_steps_are_refused_by_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(builder, "MAX_STEPS", 1_000)
    with pytest.raises(TraceError, match="Line 1001: a trace may have 1,000 steps"):
        read("70000\n30000.5\n" * 600)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("5000\n\n\n3e8\n", "Line 4: down_kbps: input should be less than or equal to 100000000."),
        ("0 1\n", "no step that lasts a millisecond"),
        ("0 1\n0.0001 1\n", "no step that lasts a millisecond"),
        ("0 1\n99999999 1\n", "Line 2: a trace may last 30 days"),
    ],
)
def test_what_is_broken_is_refused_with_one_sentence(text: str, sentence: str) -> None:
    assert_refused(text, sentence)
