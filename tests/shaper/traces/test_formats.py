"""The published formats: recognised by content, in the right units, and refused if unknown."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.shaper.traces.recordings import GHENT, IRISH, SABRE, assert_refused, down
from tests.shared_data import shared_file
from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.formats import load_trace, parse_trace, recognise, trace_name
from tigas_shaper.traces.text import decode
from tigas_shaper.traces.trace import NetworkTrace, TraceError


@pytest.mark.parametrize(
    ("text", "format"),
    [
        ("t_ms,down_kbps\n0,1\n", "tigas"),
        (GHENT, "ghent-4g"),
        (SABRE, "sabre"),
        (IRISH, "irish-5g"),
        ("0.0\t4.03\n0.55 4.79\n", "pensieve"),
        ("0\n0\n1\n1\n4\n", "mahimahi"),
        ("1\n", "mahimahi"),  # 12 Mbit/s, from Mahimahi's own manual
        ("7\n7\n9\n140000\n", "mahimahi"),
        ("5000\n", "plain"),
        ("5000\n5000\n20000\n", "plain"),  # whole and never falling, but far apart
        ("0.5\n0.7\n", "plain"),
        ("100\n98\n56\n20\n0\n36\n", "plain"),  # close together, but often falling
    ],
)
def test_the_content_tells_the_format(text: str, format: str) -> None:
    assert recognise(text) == format
    assert recognise("\n\n" + text) == format


def test_the_uplink_of_a_recording_of_one_direction_can_be_set() -> None:
    assert {state.up_kbps for state in parse_trace("t", GHENT.encode(), up_kbps=4_000).states} == {4_000}


@given(st.binary(max_size=300) | st.text(st.sampled_from('0123456789.,-eE \n\t[]{}":ndul_msDLbitrae')).map(str.encode))
def test_any_bytes_become_a_trace_or_one_sentence(data: bytes) -> None:
    with suppress(TraceError):
        assert parse_trace("t", data).duration_ms > 0


@pytest.mark.parametrize(
    ("filename", "name"),
    [
        ("report_bus_0001.log", "report_bus_0001"),
        ("driving_B_2019.12.16_14.23.32.csv.gz", "driving_B_2019.12.16_14.23.32"),
        ("Verizon-LTE-short.down.gz", "Verizon-LTE-short.down"),
        ("../../etc/passwd", "passwd"),
        ("..", "trace"),
        ("my trace (1).csv", "my-trace-1-"),
        ("é.csv", "trace"),
        ("x" * 300 + ".csv", "x" * 100),
    ],
)
def test_a_files_name_becomes_a_valid_name(filename: str, name: str) -> None:
    assert trace_name(filename) == name
    NetworkTrace(name, (0,), (LinkSetting(1, 1),), 1)


@pytest.mark.parametrize(
    ("parts", "format", "mbps", "seconds"),
    [
        (("ghent4g-original", "report_bus_0001.log"), "ghent-4g", 27.597, 606.726),
        (("ghent4g-sabre-json", "report_bus_0001.json"), "sabre", 27.597, 606.726),
        (("irish5g", "static_B_2020.02.14_13.21.26.csv.gz"), "irish-5g", 130.2, 1103),
        (("mahimahi", "Verizon-LTE-short.down.gz"), "mahimahi", 5.0276, 140),
        (("mahimahi", "TMobile-LTE-short.down.gz"), "mahimahi", 16.703, 139.986),
        (("norway3g", "norway_bus_1.txt"), "pensieve", 2.9116, 154.76),
    ],
)
def test_units_are_right_on_published_recordings(
    parts: tuple[str, str], format: str, mbps: float, seconds: float
) -> None:
    path = shared_file("traces", *parts)
    assert recognise(decode(path.read_bytes())) == format
    trace = load_trace(path)
    assert trace.mean_down_kbps / 1000 == pytest.approx(mbps, rel=1e-3)
    assert trace.duration_ms / 1000 == pytest.approx(seconds)


def test_every_published_recording_at_hand_is_read() -> None:
    paths = [path for path in shared_file("traces").glob("*/*") if not path.name.startswith("LICENSE")]
    assert len(paths) > 15
    for path in paths:
        assert 100 < load_trace(path).mean_down_kbps < 200_000, path.name


def test_the_same_drive_in_two_formats_is_the_same_trace() -> None:
    original = load_trace(shared_file("traces", "ghent4g-original", "report_bus_0001.log"))
    sabre = load_trace(shared_file("traces", "ghent4g-sabre-json", "report_bus_0001.json"))
    assert original.times_ms == sabre.times_ms
    assert down(original) == pytest.approx(down(sabre), abs=1)  # Sabre's are cut to whole kbit/s


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("hello world and more\n", "Line 1: 'hello world and more' is the beginning of no trace format"),
        ("a,b\n1,2\n", "Line 1: a comma-separated trace has t_ms and down_kbps, or DL_bitrate"),
    ],
)
def test_what_is_broken_is_refused_with_one_sentence(text: str, sentence: str) -> None:
    assert_refused(text, sentence)
