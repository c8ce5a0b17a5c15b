"""The published formats: recognised by content, in the right units, and refused by line when they are broken."""

from __future__ import annotations

import gzip
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.shared_data import shared_file
from tigas_shaper import importers, trace_text
from tigas_shaper.importers import combine, load_trace, parse_trace, recognise, trace_name
from tigas_shaper.trace import LinkState, NetworkTrace, TraceError

GHENT = "1450274031248 725 51.06 3.73 3263799 725\n1450274032248 1725 51.06 3.73 4226240 1000\n"
SABRE = """[
 {"duration_ms": 725, "bandwidth_kbps": 36014, "latency_ms": 20},
 {"duration_ms": 1000, "bandwidth_kbps": 0}
]
"""
IRISH = """Timestamp,Longitude,NetworkMode,DL_bitrate,UL_bitrate
2019.12.16_14.23.30,-8.4,5G,-,7
2019.12.16_14.23.32,-8.4,5G,100,66
2019.12.16_14.23.32,-8.4,5G,300,36
2019.12.16_14.23.33,-8.4,5G,-,36
2019.12.16_14.23.37,-8.4,5G,50,-
"""


def read(text: str | bytes, **options: float) -> NetworkTrace:
    return parse_trace("t", text.encode() if isinstance(text, str) else text, **options)


def down(trace: NetworkTrace) -> list[float]:
    return [state.down_kbps for state in trace.states]


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


def test_ghent_counts_bytes_and_states_last_as_long_as_their_interval() -> None:
    trace = read(GHENT)
    assert trace.times_ms == (0, 725)
    assert trace.duration_ms == 1725
    assert down(trace) == pytest.approx([3263799 * 8 / 725, 33809.92])


def test_sabre_is_in_kbits_and_its_latency_is_a_round_trip() -> None:
    trace = read(SABRE)
    assert trace.states == (LinkState(36014, 10_000, 10), LinkState(0, 10_000, 0))
    assert (trace.times_ms, trace.duration_ms) == ((0, 725), 1725)


def test_mahimahi_counts_1500_byte_packets_in_bins_of_100_ms() -> None:
    trace = read("0\n5\n99\n100\n250\n250\n")
    assert (trace.times_ms, trace.duration_ms) == ((0, 100, 200), 250)
    # 3, 1 and 2 packets of 12 000 bit, the last bin being 50 ms long
    assert down(trace) == [360, 120, 480]


def test_a_mahimahi_pattern_shorter_than_a_bin_is_its_mean_rate() -> None:
    trace = read("1\n")
    assert (down(trace), trace.duration_ms) == ([12_000], 100)


def test_a_pensieve_rate_holds_up_to_the_time_on_its_line() -> None:
    trace = read("0.0 9\n0.5 1.5\n2.0 3\n")
    assert (trace.times_ms, trace.duration_ms, down(trace)) == ((0, 500), 2000, [1500, 3000])


def test_parts_of_milliseconds_add_up_and_do_not_drift() -> None:
    trace = read("".join(f"{line * 0.2504:.4f} 1\n" for line in range(11)))
    assert trace.times_ms[:4] == (0, 250, 501, 751)
    assert trace.duration_ms == 2504


def test_irish_rows_of_one_second_are_averaged_gaps_hold_and_uplink_traffic_is_no_capacity() -> None:
    trace = read(IRISH)
    assert (trace.times_ms, trace.duration_ms) == ((0, 1000, 5000), 6000)
    assert down(trace) == [200, 200, 50]
    assert {state.up_kbps for state in trace.states} == {10_000}


def test_a_plain_list_is_one_rate_a_second() -> None:
    trace = read("5000\n2500.5\n0\n")
    assert (trace.times_ms, trace.duration_ms, down(trace)) == ((0, 1000, 2000), 3000, [5000, 2500.5, 0])


def test_the_uplink_of_a_recording_of_one_direction_can_be_set() -> None:
    assert {state.up_kbps for state in read(GHENT, up_kbps=4_000).states} == {4_000}


def test_gzip_is_read_like_the_text_in_it() -> None:
    assert read(gzip.compress(GHENT.encode())) == read(GHENT)
    assert read(b"\xef\xbb\xbf" + GHENT.encode()) == read(GHENT)


def test_two_directions_become_one_trace_and_the_shorter_uplink_repeats() -> None:
    both = combine(read("5000\n4000\n"), read("1000\n2000\n0\n"))
    assert [(state.down_kbps, state.up_kbps) for state in both.states] == [(5000, 1000), (4000, 2000)]
    both = combine(read("5000\n4000\n3000\n"), NetworkTrace("up", (0, 400), (LinkState(1, 9), LinkState(2, 9)), 700))
    assert both.times_ms == (0, 400, 700, 1000, 1100, 1400, 1800, 2000, 2100, 2500, 2800)
    assert [state.up_kbps for state in both.states] == [1, 2, 1, 1, 2, 1, 2, 2, 1, 2, 1]
    assert both.duration_ms == 3000


def test_directions_that_change_too_often_together_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importers, "MAX_STEPS", 1_000)
    hasty = NetworkTrace("up", (0, 1), (LinkState(1, 1), LinkState(2, 1)), 2)
    with pytest.raises(TraceError, match="1,000 steps"):
        combine(NetworkTrace("t", (0,), (LinkState(1, 1),), 300_000), hasty)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "The file is empty."),
        (" \n\t\n", "The file is empty."),
        (b"\x89PNG\r\n\x1a\n\0\0", "binary"),
        (b"5000\n\xff\xfe\n", "binary"),
        ("5000\n\0\n", "binary"),
        (b"\x1f\x8bnonsense", "gzip file is damaged"),
        (gzip.compress(GHENT.encode())[:-12], "gzip file is damaged"),
        ("hello\n", "Line 1: each line of this file must be a number, not 'hello'."),
        ("hello world and more\n", "Line 1: 'hello world and more' is the beginning of no trace format"),
        ("a,b\n1,2\n", "Line 1: a comma-separated trace has t_ms and down_kbps, or DL_bitrate"),
        ("5000\nfast\n", "Line 2: each line of this file must be a number, not 'fast'."),
        ("5000\n-1\n", "Line 2: each line of this file must not be negative"),
        ("5000\nnan\n", "Line 2: each line of this file must be a number, not 'nan'."),
        ("5000\n1e999\n", "Line 2: each line of this file is too large"),
        ("5000\n\n\n3e8\n", "Line 4: down_kbps must be between 0 and 100000000"),
        ("9" * 9_000 + "\n", "Line 1: each line of this file must be a number"),
        ("9" * 20_000 + "\n", "Line 1 is longer than 10,000 characters."),
        ("".join(f"{stamp}\n" for stamp in (*range(50), 20, *range(50, 60))), "Line 51: time must not go back"),
        (GHENT + "1 2 3\n", "Line 3: a Ghent 4G log has 6 columns, not 3."),
        (GHENT + "1 900 51 3 5 1000\n", "Line 3: time must not go back, but 900 ms comes after 1725 ms."),
        (GHENT + "1 2725 51 3 5 0\n", "Line 3: the interval must not be 0 ms."),
        (GHENT + "1 2725 51 3 inf 1000\n", "Line 3: the bytes must be a number, not 'inf'."),
        ("0 1\n1 2 3\n", "Line 2: two columns are expected"),
        ("0 1\n2 2\n1 2\n", "Line 3: time must rise, but 1 s comes after 2 s."),
        ("0 1\n", "no step that lasts a millisecond"),
        ("0 1\n0.0001 1\n", "no step that lasts a millisecond"),
        ("0 1\n99999999 1\n", "Line 2: a trace may last 30 days"),
        (IRISH + "2019.12.16_14.23.31,1,1,1,1\n", "Line 7: time must not go back"),
        (IRISH + "yesterday,1,1,1,1\n", "Line 7: Timestamp must look like"),
        (IRISH + "2019.12.16_14.23.38,1\n", "Line 7: 5 cells are expected, not 2."),
        (IRISH + "2019.12.16_14.23.38,1,1,x,1\n", "Line 7: DL_bitrate must be a number, not 'x'."),
        (IRISH + '2019.12.16_14.23.38,"1,1,x,1\n', "Line 7: the quotes do not match."),
        ("Timestamp,DL_bitrate\n2019.12.16_14.23.38,-\n", "No row has a DL_bitrate."),
        ("Time,DL_bitrate\n1,2\n", "Line 1: the header lacks Timestamp."),
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
def test_a_broken_recording_is_refused_with_one_sentence(text: str | bytes, sentence: str) -> None:
    with pytest.raises(TraceError) as error:
        read(text)
    assert sentence in error.value.detail
    assert "\n" not in error.value.detail
    assert len(error.value.detail) < 250


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


def test_too_many_steps_are_refused_by_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trace_text, "MAX_STEPS", 1_000)
    with pytest.raises(TraceError, match="Line 1001: a trace may have 1,000 steps"):
        read("70000\n30000.5\n" * 600)


def test_a_gzip_bomb_costs_no_more_than_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trace_text, "MAX_BYTES", 1_000_000)
    bomb = gzip.compress(b"5000\n" * 10_000_000)  # 50 MB from 50 kB
    unpacked: list[int] = []
    original = gzip.GzipFile.read

    def counting(self: gzip.GzipFile, size: int | None = -1) -> bytes:
        data: bytes = original(self, size)
        unpacked.append(len(data))
        return data

    monkeypatch.setattr(gzip.GzipFile, "read", counting)
    with pytest.raises(TraceError, match="larger than 1 MB"):
        read(bomb)
    assert unpacked == [1_000_001]


def test_a_huge_file_is_refused_without_reading_it_whole(tmp_path: Path) -> None:
    huge = tmp_path / "huge.csv"
    with huge.open("wb") as file:
        file.truncate(1 << 30)  # sparse
    with pytest.raises(TraceError, match="larger than 64 MB"):
        load_trace(huge)


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
    NetworkTrace(name, (0,), (LinkState(1, 1),), 1)


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
    assert recognise(trace_text.decode(path.read_bytes())) == format
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
