"""Sabre's JSON (Spiteri et al. 2018): a list of {duration_ms, bandwidth_kbps, latency_ms}.

Sabre's latency is the time from a request to the first bit of its answer, hence a round trip: half of it is our
one-way delay.
"""

from __future__ import annotations

import json
import math
import re

from tigas_shaper.traces.builder import TraceBuilder
from tigas_shaper.traces.trace import NetworkTrace, TraceError

MAX_ENTRY = 1000
"""Characters of one period."""
_SPACE = re.compile(r"[ \t\r\n]*")
_LIST = "the JSON must be a list of {duration_ms, bandwidth_kbps, latency_ms}"


def parse_sabre(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Each period becomes a state. Raises TraceError.

    Periods are flat, so they are read one at a time: a hostile file builds no deep or large structure.
    """
    builder = TraceBuilder(name)
    line, at = 1, 0

    def next_token(position: int) -> tuple[int, str]:
        nonlocal line, at
        match = _SPACE.match(text, position)
        start = match.end() if match else position
        line, at = line + text.count("\n", at, start), start
        return start, text[start : start + 1]

    position, token = next_token(0)
    if token != "[":
        raise TraceError(f"Line {line}: {_LIST}.")
    while token != "]":
        position, token = next_token(position + 1)
        if token != "{":
            raise TraceError(f"Line {line}: {_LIST}.")
        end = text.find("}", position, position + MAX_ENTRY)
        if end < 0:
            raise TraceError(f"Line {line}: the JSON breaks off, or an entry is longer than {MAX_ENTRY} characters.")
        entry = _entry(text[position : end + 1], line)
        duration = _value(entry, "duration_ms", line)
        if duration == 0:
            raise TraceError(f"Line {line}: duration_ms must not be 0.")
        latency = _value(entry, "latency_ms", line) if "latency_ms" in entry else 0.0
        builder.add(line, duration, _value(entry, "bandwidth_kbps", line), up_kbps, latency / 2)
        position, token = next_token(end + 1)
        if token not in (",", "]"):
            raise TraceError(f"Line {line}: after an entry comes a comma or the end of the list.")
    if next_token(position + 1)[1]:
        raise TraceError(f"Line {line}: there is something after the end of the list.")
    return builder.build()


def _entry(text: str, line: int) -> dict[str, object]:
    try:
        entry: dict[str, object] = json.loads(text, parse_int=float)
    except (ValueError, RecursionError):
        raise TraceError(f"Line {line}: this is not valid JSON; {_LIST}.") from None
    return entry


def _value(entry: dict[str, object], key: str, line: int) -> float:
    value = entry.get(key)
    if not isinstance(value, float) or not math.isfinite(value) or value < 0:
        raise TraceError(f"Line {line}: {key} must be a number that is not negative.")
    return value
