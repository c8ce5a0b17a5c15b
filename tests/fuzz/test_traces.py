"""Any input of `tigas trace import` and of the shaper becomes a trace or is refused in a sentence."""

from __future__ import annotations

import gzip
import tracemalloc
from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz.byte_edits import edited
from tests.fuzz.fuzzers import assert_sentence, effort
from tests.shaper.traces.recordings import GHENT, IRISH, SABRE
from tigas_shaper.traces.csv_format import format_csv, parse_csv
from tigas_shaper.traces.formats import FORMATS, parse_trace, trace_name
from tigas_shaper.traces.library import summarise, trace_outline
from tigas_shaper.traces.text import MAX_BYTES
from tigas_shaper.traces.trace import TraceError

TIGAS = "t_ms,down_kbps,up_kbps,delay_ms,jitter_ms,loss_pct\n0,5000,1000,20,,\n500,0,,,2.5,\n800,,,40,,1\n1000,,,,,\n"
SOUND = (TIGAS, GHENT, SABRE, IRISH, "0.0\t4.03\n0.55 4.79\n1 0\n", "0\n0\n1\n1\n4\n120\n", "5000\n0.5\n20000\n")
PIECES = (
    *(b",", b"\n", b"\r", b"\t", b" ", b'"', b"'", b"[", b"]", b"{"),
    *(b"}", b":", b"-", b"#", b"\0", b"\xff", b"\xef\xbb\xbf"),
    *(b"nan", b"inf", b"-1", b"1e308", b"1e-320", b"1e999", b"9" * 30, b"9" * 400, b"0", b"0.5", b"1_0", "٣".encode()),
    *(b"t_ms", b"down_kbps", b"DL_bitrate", b"Timestamp", b"0001.01.01_00.00.00", b"9999.12.31_23.59.59", b"\x1f\x8b"),
    *(b"2592000000", b"2592000001", b"\x1c", "\u2028".encode(), b"x" * 11_000, b"[" * 3000),
)  # fmt: skip
MOST_MEMORY = 2000
"""Bytes for each of the text's: a step of two characters is an object."""
UNPACKED = 2 * MAX_BYTES
"""Additional bytes that a packed file may take, for any contents."""

texts = edited(st.sampled_from(SOUND).map(str.encode), PIECES)
files = texts | texts | edited(texts.map(partial(gzip.compress, mtime=0)))


@effort(200)
@given(files, st.none() | st.sampled_from(sorted(FORMATS)))
def test_any_file_is_a_trace_or_one_sentence(data: bytes, format: str | None) -> None:
    tracemalloc.start()
    try:
        trace = parse_trace("t", data, format=format)
    except TraceError as error:
        assert_sentence(error.detail)
        return
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        packed = data.startswith(b"\x1f\x8b")
        assert peak < MOST_MEMORY * (len(data) + 10_000) + packed * UNPACKED
    assert parse_csv("t", format_csv(trace)) == trace
    summarise(trace, uploaded=True)
    assert len(trace_outline(trace).times_ms) == len(trace_outline(trace).down_kbps)
    for moment in (0, trace.duration_ms / 3, trace.duration_ms, 1e12):
        assert trace.state_at(moment) in trace.states


@effort()
@given(texts, texts)
def test_two_directions_of_any_files_are_put_together_or_refused(down: bytes, up: bytes) -> None:
    try:
        together = parse_trace("t", down).with_uplink(parse_trace("t", up))
    except TraceError as error:
        assert_sentence(error.detail)
    else:
        assert together.duration_ms > 0


@effort()
@given(st.text(max_size=300) | st.sampled_from(["..", "../../x.csv", ".csv", "a" * 300, "x.gz.gz", "\0.csv", "/"]))
def test_any_name_of_a_file_gives_a_name_that_is_safe(filename: str) -> None:
    name = trace_name(filename)
    assert parse_trace(name, TIGAS.encode()).name == name
    assert name.isascii()
    assert not set(name) & set("/\\\0")
