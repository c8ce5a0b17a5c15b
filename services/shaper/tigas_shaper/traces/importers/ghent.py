"""4G/LTE logs of Ghent (van der Hooft et al. 2016) and the 3G logs of Norway (Riiser et al. 2013) in their own format.

Six columns: time stamp, ms since the start, latitude, longitude, BYTES received since the line before, ms since the
line before. So kbit/s = bytes × 8 / ms; a well-known copy of these logs holds kilobytes per second instead and is
replayed at one eighth of the recorded rate.
"""

from __future__ import annotations

from tigas_shaper.traces.builder import TraceBuilder
from tigas_shaper.traces.text import lines, number
from tigas_shaper.traces.trace import NetworkTrace, TraceError


def parse_ghent(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Each line becomes a state that lasts as long as its interval. Raises TraceError."""
    builder = TraceBuilder(name)
    before = 0.0
    for line, content in lines(text):
        cells = content.split()
        if len(cells) != 6:
            raise TraceError(f"Line {line}: a Ghent 4G log has 6 columns, not {len(cells)}.")
        elapsed = number(cells[1], line, "the time since the start")
        received, interval = number(cells[4], line, "the bytes"), number(cells[5], line, "the interval")
        if elapsed < before:
            raise TraceError(f"Line {line}: time must not go back, but {elapsed:g} ms comes after {before:g} ms.")
        if interval == 0:
            raise TraceError(f"Line {line}: the interval must not be 0 ms.")
        builder.add(line, interval, received * 8 / interval, up_kbps)
        before = elapsed
    return builder.build()
