"""Reads traces in our own format and in the formats of published recordings; detected by content, never by name."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path, PurePath

from tigas_common.wire.shaper import TRACE_SUFFIXES
from tigas_shaper.traces import importers
from tigas_shaper.traces.csv_format import parse_csv
from tigas_shaper.traces.text import DEFAULT_UP_KBPS, decode, lines, quoted, read_bounded
from tigas_shaper.traces.trace import NetworkTrace, TraceError

FORMATS: dict[str, Callable[[str, str, float], NetworkTrace]] = {
    "tigas": parse_csv,
    "ghent-4g": importers.parse_ghent,
    "sabre": importers.parse_sabre,
    "mahimahi": importers.parse_mahimahi,
    "pensieve": importers.parse_pensieve,
    "irish-5g": importers.parse_irish,
    "plain": importers.parse_plain,
}
"""Parsers by the name of their format; each takes a trace's name, the text, and the uplink where none is recorded."""

_LINK = re.compile(r"\d+(\.\d+)?(mbit|kbit|ms-rtt|ms-jitter)|unshaped$")
"""Begins a network that is no trace, such as `5mbit`, in an experiment's file."""


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
    """The format of a trace's text. Raises TraceError if it is unknown."""
    line, first = next(lines(text)) if text.lstrip()[:1] not in ("[", "{") else (1, "[")
    if first == "[":
        return "sabre"
    if "," in first:
        names = {cell.strip() for cell in first.split(",")}
        if "t_ms" in names:
            return "tigas"
        if "DL_bitrate" in names:
            return "irish-5g"
        raise TraceError(f"Line {line}: a comma-separated trace has t_ms and down_kbps, or DL_bitrate, in its header.")
    words = first.split()
    if len(words) == 1:
        return "mahimahi" if importers.holds_packet_times(text) else "plain"
    if len(words) == 2:
        return "pensieve"
    if len(words) == 6:
        return "ghent-4g"
    raise TraceError(f"Line {line}: {quoted(first)} does not begin any trace format that TIGAS reads.")


def trace_name(filename: str) -> str:
    """A valid trace name for a file: no folder, no suffix, and a hyphen for invalid characters.

    A name that an experiment's file would take for another network follows `trace-`.
    """
    path = PurePath(PurePath(filename).name)
    while path.suffix.lower() in TRACE_SUFFIXES:
        path = path.with_suffix("")
    name = re.sub(r"[^A-Za-z0-9._+=-]+", "-", path.name).lstrip("._+=-") or "trace"
    return (f"trace-{name}" if _LINK.match(name) else name)[:100]
