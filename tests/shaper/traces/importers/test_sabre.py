"""Sabre's JSON: one period at a time, without deep nesting."""

from __future__ import annotations

import pytest

from tests.shaper.traces.recordings import SABRE, assert_refused, read
from tigas_common.wire.shaper import LinkSetting


def test_sabre_is_in_kbits_and_its_latency_is_a_round_trip() -> None:
    trace = read(SABRE)
    assert trace.states == (LinkSetting(36014, 10_000, 10), LinkSetting(0, 10_000, 0))
    assert (trace.times_ms, trace.duration_ms) == ((0, 725), 1725)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('{"a": 1}', "Line 1: the JSON must be a list of"),
        ("[]", "Line 1: the JSON must be a list of"),
        ("[1, 2]", "Line 1: the JSON must be a list of"),
        ("[" * 100_000, "Line 1: the JSON must be a list of"),
        ('[{"duration_ms": ' * 1000, "breaks off"),
        ('[{"duration_ms": ' * 50 + "}", "is not valid JSON"),
        ('[{"a":' * 100_000, "breaks off"),
        ("[\n{}\n]", "Line 2: duration_ms must be a number"),
        ('[{"duration_ms": 1000}]', "Line 1: bandwidth_kbps must be a number"),
        ('[{"duration_ms": 0, "bandwidth_kbps": 1}]', "Line 1: duration_ms must not be 0."),
        ('[{"duration_ms": true, "bandwidth_kbps": 1}]', "Line 1: duration_ms must be a number"),
        ('[{"duration_ms": "1000", "bandwidth_kbps": 1}]', "Line 1: duration_ms must be a number"),
        ('[{"duration_ms": 1000, "bandwidth_kbps": NaN}]', "Line 1: bandwidth_kbps must be a number"),
        ('[{"duration_ms": 1000, "bandwidth_kbps": -1}]', "Line 1: bandwidth_kbps must be a number that is not neg"),
        ('[{"duration_ms": 1000, "bandwidth_kbps": 1e999}]', "Line 1: bandwidth_kbps must be a number"),
        ('[{"duration_ms": 1000, "bandwidth_kbps": {"a": 1}}]', "Line 1: this is not valid JSON"),
        (SABRE.replace("},", "}"), "Line 3: after an entry comes a comma or the end of the list."),
        (SABRE[:-3], "Line 3: after an entry comes a comma or the end of the list."),
        (SABRE[:-12], "Line 3: the JSON breaks off"),
        (SABRE + "x", "Line 5: there is something after the end of the list."),
    ],
)
def test_what_is_broken_is_refused_with_one_sentence(text: str, sentence: str) -> None:
    assert_refused(text, sentence)
