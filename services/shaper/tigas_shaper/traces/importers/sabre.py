"""Sabre's JSON (Spiteri et al. 2018): a list of {duration_ms, bandwidth_kbps, latency_ms}.

Sabre's latency is the time from a request to the first bit of its answer, hence a round trip: half of it is our
one-way delay.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator

from tigas_shaper.traces.trace import NetworkTrace, TraceBuilder, TraceError

_BEGIN = re.compile(r"\s*\[\s*")
_PERIOD = re.compile(r"(\{[^{}]{0,1000}\})\s*[,\]]\s*")
"""One period. Periods are flat: a hostile file builds no deep or large structure."""


def parse_sabre(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Each period becomes a state. Raises TraceError."""
    builder = TraceBuilder(name)
    for line, period in _periods(text):
        duration = _value(period, "duration_ms", line)
        if duration == 0:
            raise TraceError(f"Line {line}: duration_ms must not be 0.")
        latency = _value(period, "latency_ms", line) if "latency_ms" in period else 0.0
        builder.add(line, duration, _value(period, "bandwidth_kbps", line), up_kbps, latency / 2)
    return builder.build()


def _periods(text: str) -> Iterator[tuple[int, dict[str, object]]]:
    """Line and fields of each period."""
    line, part = 1, _BEGIN.match(text)
    while part is not None:
        line, position = line + part[0].count("\n"), part.end()
        if part[0].rstrip().endswith("]"):
            if position < len(text):
                raise TraceError(f"Line {line}: there is something after the end of the list.")
            return
        part = _PERIOD.match(text, position)
        if part is not None:
            try:
                period = json.loads(part[1], parse_int=float)
            except (ValueError, RecursionError):
                break
            yield line, period
    expected = "a list of {duration_ms, bandwidth_kbps, latency_ms}"
    raise TraceError(f"Line {line}: the JSON is damaged, or not {expected}.")


def _value(period: dict[str, object], key: str, line: int) -> float:
    value = period.get(key)
    if not isinstance(value, float) or not math.isfinite(value) or value < 0:
        raise TraceError(f"Line {line}: {key} must be a number that is not negative.")
    return value
