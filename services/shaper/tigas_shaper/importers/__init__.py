"""Reads recorded network traces in the formats that they are published in; the content tells which, never the name."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path, PurePath

from tigas_shaper.csv_format import parse_csv
from tigas_shaper.importers.column import holds_packet_times, parse_mahimahi, parse_plain
from tigas_shaper.importers.ghent import parse_ghent
from tigas_shaper.importers.irish import parse_irish
from tigas_shaper.importers.pensieve import parse_pensieve
from tigas_shaper.importers.sabre import parse_sabre
from tigas_shaper.trace import MAX_STEPS, LinkState, NetworkTrace, TraceError
from tigas_shaper.trace_text import DEFAULT_UP_KBPS, decode, lines, read_bounded, shown

__all__ = ["DEFAULT_UP_KBPS", "FORMATS", "combine", "load_trace", "parse_trace", "recognise", "trace_name"]

FORMATS: dict[str, Callable[[str, str, float], NetworkTrace]] = {
    "tigas": parse_csv,
    "ghent-4g": parse_ghent,
    "sabre": parse_sabre,
    "mahimahi": parse_mahimahi,
    "pensieve": parse_pensieve,
    "irish-5g": parse_irish,
    "plain": parse_plain,
}
"""Parsers by the name of their format; each takes a trace's name, the text, and the uplink where none is recorded."""

_SUFFIXES = {".gz", ".csv", ".json", ".txt", ".log"}


def load_trace(path: Path, *, up_kbps: float = DEFAULT_UP_KBPS, format: str | None = None) -> NetworkTrace:
    """The trace in a file, named after it. Raises TraceError and OSError."""
    return parse_trace(trace_name(path.name), read_bounded(path), up_kbps=up_kbps, format=format)


def parse_trace(name: str, data: bytes, *, up_kbps: float = DEFAULT_UP_KBPS, format: str | None = None) -> NetworkTrace:
    """The trace in a file's bytes, perhaps gzipped; `format` is one of FORMATS, recognised if None. Raises TraceError.

    Takes time in proportion to the bytes, some ten seconds for the 64 MB that are the limit: not for an event loop.
    """
    text = decode(data)
    return FORMATS[format or recognise(text)](name, text, up_kbps)


def recognise(text: str) -> str:
    """The format of a trace's text. Raises TraceError if it is none of ours."""
    line, first = next(lines(text)) if text.lstrip()[:1] not in ("[", "{") else (1, "[")
    if first == "[":
        return "sabre"
    if "," in first:
        columns = {cell.strip() for cell in first.split(",")}
        if "t_ms" in columns:
            return "tigas"
        if "DL_bitrate" in columns:
            return "irish-5g"
        raise TraceError(f"Line {line}: a comma-separated trace has t_ms and down_kbps, or DL_bitrate, in its header.")
    words = first.split()
    if len(words) == 1:
        return "mahimahi" if holds_packet_times(text) else "plain"
    if len(words) == 2:
        return "pensieve"
    if len(words) == 6:
        return "ghent-4g"
    raise TraceError(f"Line {line}: {shown(first)} is the beginning of no trace format that TIGAS reads.")


def combine(down: NetworkTrace, up: NetworkTrace) -> NetworkTrace:
    """`down` with the rates of `up`, a recording of the other direction, as its uplink; it repeats if it is shorter.

    Mahimahi, for one, publishes the two directions as two files. Raises TraceError.
    """
    times: list[int] = []
    states: list[LinkState] = []
    time = 0
    while time < down.duration_ms:
        if len(times) == MAX_STEPS:
            raise TraceError(f"A trace may have {MAX_STEPS:,} steps; the two together have more.")
        times.append(time)
        states.append(replace(down.at(time), up_kbps=up.at(time).down_kbps))
        time = min(_next_change(down, time), _next_change(up, time))
    return NetworkTrace(down.name, tuple(times), tuple(states), down.duration_ms)


def trace_name(filename: str) -> str:
    """A valid name for the trace of a file: no folder, no suffix, and a hyphen for what a name cannot hold."""
    path = PurePath(PurePath(filename).name)
    while path.suffix.lower() in _SUFFIXES:
        path = path.with_suffix("")
    return re.sub(r"[^A-Za-z0-9._+=-]+", "-", path.name).lstrip("._+=-")[:100] or "trace"


def _next_change(trace: NetworkTrace, time: int) -> int:
    turn, within = divmod(time, trace.duration_ms)
    index = bisect_right(trace.times_ms, within)
    return turn * trace.duration_ms + (trace.times_ms[index] if index < len(trace.times_ms) else trace.duration_ms)
