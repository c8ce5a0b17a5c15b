"""All formats: recognised by content, in the right units, and refused with the line of a fault."""

from __future__ import annotations

import gzip
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.shaper.traces.recordings import GHENT, HEADER, IRISH, SABRE, read
from tests.shared_data import shared_file
from tigas_common.wire.shaper import MAX_DURATION_MS, LinkSetting
from tigas_shaper.traces import text as text_module
from tigas_shaper.traces.csv_format import format_csv, parse_csv
from tigas_shaper.traces.formats import detect_format, load_trace, parse_trace, trace_name
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
    assert detect_format(text) == format
    assert detect_format("\n\n" + text) == format


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
        ("5mbit.csv", "trace-5mbit"),
        ("unshaped.csv", "trace-unshaped"),
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
    assert detect_format(decode(path.read_bytes())) == format
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
    assert original.down_kbps == pytest.approx(sabre.down_kbps, abs=1)  # Sabre's are cut to whole kbit/s


def test_mahimahi_counts_1500_byte_packets_in_bins_of_100_ms() -> None:
    trace = read("0\n5\n99\n100\n250\n250\n")
    assert (trace.times_ms, trace.duration_ms) == ((0, 100, 200), 250)
    # 3, 1 and 2 packets of 12 000 bit, the last bin being 50 ms long
    assert trace.down_kbps == (360, 120, 480)
    assert read("0\n5\n150\n200\n200\n").down_kbps == (240, 360), "packets at the end belong to the last bin"
    pattern = read("1\n")
    assert (pattern.down_kbps, pattern.duration_ms) == ((12_000,), 100), "the mean of what is shorter than a bin"


def test_a_plain_list_is_one_rate_a_second() -> None:
    trace = read("5000\n2500.5\n0\n")
    assert (trace.times_ms, trace.duration_ms, trace.down_kbps) == ((0, 1000, 2000), 3000, (5000, 2500.5, 0))


def test_ghent_counts_bytes_and_states_last_as_long_as_their_interval() -> None:
    trace = read(GHENT)
    assert (trace.times_ms, trace.duration_ms) == ((0, 725), 1725)
    assert trace.down_kbps == pytest.approx((3263799 * 8 / 725, 33809.92))


def test_a_pensieve_rate_holds_up_to_the_time_on_its_line() -> None:
    trace = read("0.0 9\n0.5 1.5\n2.0 3\n")
    assert (trace.times_ms, trace.duration_ms, trace.down_kbps) == ((0, 500), 2000, (1500, 3000))


def test_irish_rows_of_one_second_are_averaged_gaps_hold_and_uplink_traffic_is_no_capacity() -> None:
    trace = read(IRISH)
    assert (trace.times_ms, trace.duration_ms) == ((0, 1000, 5000), 6000)
    assert trace.down_kbps == (200, 200, 50)
    assert set(trace.up_kbps) == {10_000}


def test_sabre_is_in_kbits_and_its_latency_is_a_round_trip() -> None:
    trace = read(SABRE)
    assert trace.states == (LinkSetting(36014, 10_000, 10), LinkSetting(0, 10_000, 0))
    assert (trace.times_ms, trace.duration_ms) == ((0, 725), 1725)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "The file is empty."),
        (" \n\t\n", "The file is empty."),
        (b"\x89PNG\r\n\x1a\n\0\0", "binary"),
        (b"5000\n\xff\xfe\n", "binary"),
        ("5000\n\0\n", "binary"),
        (b"\x1f\x8bnonsense", "gzip file is damaged"),
        (gzip.compress(GHENT.encode(), mtime=0)[:-12], "gzip file is damaged"),
        ("9" * 20_000 + "\n", "Line 1 is longer than 10,000 characters."),
        ("hello world and more\n", "Line 1: 'hello world and more' is not the start of any trace format"),
        ("a,b\n1,2\n", "Line 1: a comma-separated trace has t_ms and down_kbps, or DL_bitrate"),
        ("t_ms,up_kbps\n0,1\n", "Line 1: the header lacks down_kbps."),
        ("t_ms,down_kbps,rtt\n0,1,2\n", "Line 1: 'rtt' is not a column"),
        ("t_ms,down_kbps,down_kbps\n0,1,2\n", "Line 1: the header has down_kbps twice."),
        ("t_ms,down_kbps\n", "a header and no line after it"),
        ("t_ms,down_kbps\n5,1\n", "Line 2: the first t_ms must be 0, not 5."),
        ("t_ms,down_kbps\n0,1\n100,2\n100,3\n", "Line 4: t_ms must increase, but 100 comes after 100."),
        ("t_ms,down_kbps\n0,1\n100,2\n50,3\n", "Line 4: t_ms must increase, but 50 comes after 100."),
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
        ("t_ms,down_kbps\n0,1,2\n", "Line 2: 2 cells expected, not 3."),
        ("t_ms,down_kbps\n0\n", "Line 2: 2 cells expected, not 1."),
        ('t_ms,down_kbps\n0,"1\n', "Line 2: the quotes do not match."),
        ("t_ms,down_kbps\n0,1\n9999999999999,2\n", "a trace may last 30 days"),
        ("5000\n\n\n3e8\n", "Line 4: down_kbps: input should be less than or equal to 100000000."),
        ("0 1\n", "no step of at least a millisecond"),
        ("0 1\n0.0001 1\n", "no step of at least a millisecond"),
        ("0 1\n99999999 1\n", "Line 2: a trace may last 30 days"),
        ("hello\n", "Line 1: each line of this file must be a number, not 'hello'."),
        ("5000\nfast\n", "Line 2: each line of this file must be a number, not 'fast'."),
        ("5000\n-1\n", "Line 2: each line of this file must not be negative"),
        ("5000\nnan\n", "Line 2: each line of this file must be a number, not 'nan'."),
        ("5000\n1e999\n", "Line 2: each line of this file is too large"),
        ("9" * 9_000 + "\n", "Line 1: each line of this file must be a number"),
        ("".join(f"{stamp}\n" for stamp in (*range(50), 20, *range(50, 60))), "Line 51: time must not go back"),
        (GHENT + "1 2 3\n", "Line 3: a Ghent 4G log has 6 columns, not 3."),
        (GHENT + "1 900 51 3 5 1000\n", "Line 3: time must not go back, but 900 ms comes after 1725 ms."),
        (GHENT + "1 2725 51 3 5 0\n", "Line 3: the interval must not be 0 ms."),
        (GHENT + "1 2725 51 3 inf 1000\n", "Line 3: the bytes must be a number, not 'inf'."),
        ("0 1\n1 2 3\n", "Line 2: two columns are expected"),
        ("0 1\n2 2\n1 2\n", "Line 3: time must increase, but 1 s comes after 2 s."),
        (IRISH + "2019.12.16_14.23.31,1,1,1,1\n", "Line 7: time must not go back"),
        (IRISH + "yesterday,1,1,1,1\n", "Line 7: Timestamp must look like"),
        (IRISH + "2019.12.16_14.23.38,1\n", "Line 7: 5 cells expected, not 2."),
        (IRISH + "2019.12.16_14.23.38,1,1,x,1\n", "Line 7: DL_bitrate must be a number, not 'x'."),
        (IRISH + '2019.12.16_14.23.38,"1,1,x,1\n', "Line 7: the quotes do not match."),
        ("Timestamp,DL_bitrate\n2019.12.16_14.23.38,-\n", "No row has a DL_bitrate."),
        ("Time,DL_bitrate\n1,2\n", "Line 1: the header lacks Timestamp."),
        ('{"a": 1}', "Line 1: the JSON is damaged, or not a list of"),
        ("[]", "Line 1: the JSON is damaged, or not a list of"),
        ("[1, 2]", "Line 1: the JSON is damaged, or not a list of"),
        ("[" * 100_000, "Line 1: the JSON is damaged, or not a list of"),
        ('[{"duration_ms": ' * 1000, "Line 1: the JSON is damaged"),
        ('[{"duration_ms": ' * 50 + "}", "Line 1: the JSON is damaged"),
        ('[{"a":' * 100_000, "Line 1: the JSON is damaged"),
        ('[{"a":' + "[" * 990 + "}]", "Line 1: the JSON is damaged"),
        ("[\n{}\n]", "Line 2: duration_ms must be a non-negative number"),
        ('[{"duration_ms": 1000}]', "Line 1: bandwidth_kbps must be a non-negative number"),
        ('[{"duration_ms": 0, "bandwidth_kbps": 1}]', "Line 1: duration_ms must not be 0."),
        ('[{"duration_ms": true, "bandwidth_kbps": 1}]', "Line 1: duration_ms must be a non-negative number"),
        ('[{"duration_ms": "1000", "bandwidth_kbps": 1}]', "Line 1: duration_ms must be a non-negative number"),
        ('[{"duration_ms": 1000, "bandwidth_kbps": NaN}]', "Line 1: bandwidth_kbps must be a non-negative number"),
        ('[{"duration_ms": 1000, "bandwidth_kbps": -1}]', "Line 1: bandwidth_kbps must be a non-neg"),
        ('[{"duration_ms": 1000, "bandwidth_kbps": 1e999}]', "Line 1: bandwidth_kbps must be a non-negative number"),
        ('[{"duration_ms": 1000, "bandwidth_kbps": {"a": 1}}]', "Line 1: the JSON is damaged"),
        (SABRE.replace("},", "}"), "Line 2: the JSON is damaged"),
        (SABRE[:-3], "Line 3: the JSON is damaged"),
        (SABRE[:-12], "Line 3: the JSON is damaged"),
        (SABRE + "x", "Line 5: unexpected text after the end of the list."),
    ],
)
def test_a_fault_is_named_by_its_line(text: str | bytes, sentence: str) -> None:
    assert_refused(text, sentence)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("0\n0\n", "Line 2: a Mahimahi trace must end after 0 ms."),
        ("1\n1.5\n", "Line 2: a Mahimahi trace holds whole milliseconds, not 1.5."),
        ("1\n9999999999\n", "Line 2: a trace may last 30 days"),
        ("1\n999999999\n", "Line 2: a trace may have 250,000 steps"),
    ],
)
def test_packet_times_that_cannot_be_are_refused(text: str, sentence: str) -> None:
    assert_refused(text, sentence, "mahimahi")


def assert_refused(text: str | bytes, sentence: str, format: str | None = None) -> None:
    """One short sentence, which holds this one."""
    with pytest.raises(TraceError) as error:
        read(text, format)
    assert sentence in error.value.detail
    assert "\n" not in error.value.detail
    assert len(error.value.detail) < 250


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


def test_gzip_is_read_like_the_text_in_it() -> None:
    assert read(gzip.compress(GHENT.encode())) == read(GHENT)
    assert read(b"\xef\xbb\xbf" + GHENT.encode()) == read(GHENT)


def test_a_gzip_bomb_costs_no_more_than_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_module, "MAX_BYTES", 1_000_000)
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
