"""Readers for traces in TIGAS's format and in formats of published recordings, detected by content, never by name."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path, PurePath

from tigas_common.wire.shaper import TRACE_SUFFIXES
from tigas_shaper.traces import importers
from tigas_shaper.traces.csv_format import parse_csv
from tigas_shaper.traces.text import DEFAULT_UP_KBPS, decode, numbered_lines, quote, read_bounded
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
"""Parsers by format name; each takes a trace's name, its text, and the uplink to use if none is recorded."""

_LINK = re.compile(r"\d+(\.\d+)?(mbit|kbit|ms-rtt|ms-jitter)|unshaped$")
"""Start of a network in an experiment file that is not a trace, such as `5mbit`."""


def load_trace(path: Path, *, up_kbps: float = DEFAULT_UP_KBPS, format: str | None = None) -> NetworkTrace:
    """Read the trace in a file, named after it. Raises TraceError and OSError."""
    return parse_trace(trace_name(path.name), read_bounded(path), up_kbps=up_kbps, format=format)


def parse_trace(name: str, data: bytes, *, up_kbps: float = DEFAULT_UP_KBPS, format: str | None = None) -> NetworkTrace:
    """Parse a trace, possibly gzipped; `format` is one of FORMATS, or None to detect it. Raises TraceError.

    Too slow for an event loop: takes about ten seconds for a file of the maximum size, 64 MB.
    """
    text = decode(data)
    return FORMATS[format or detect_format(text)](name, text, up_kbps)


def detect_format(text: str) -> str:
    """Detect the format of a trace. Raises TraceError if it is unknown."""
    line, first = next(numbered_lines(text)) if text.lstrip()[:1] not in ("[", "{") else (1, "[")
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
        return "mahimahi" if importers.is_packet_times(text) else "plain"
    if len(words) == 2:
        return "pensieve"
    if len(words) == 6:
        return "ghent-4g"
    raise TraceError(f"Line {line}: {quote(first)} is not the start of any trace format that TIGAS reads.")


def trace_name(filename: str) -> str:
    """A valid trace name for a file: without folder and suffix, and with hyphens for invalid characters.

    A name that an experiment file would interpret as another network gets the prefix `trace-`.
    """
    path = PurePath(PurePath(filename).name)
    while path.suffix.lower() in TRACE_SUFFIXES:
        path = path.with_suffix("")
    name = re.sub(r"[^A-Za-z0-9._+=-]+", "-", path.name).lstrip("._+=-") or "trace"
    return (f"trace-{name}" if _LINK.match(name) else name)[:100]
