"""Lines of "seconds Mbit/s", the form of the Norwegian, FCC and Puffer sets in Pensieve (Mao et al. 2017) and later
work.

As in Pensieve's simulator, a line's rate was measured since the previous line, so it applies from there to its own
time, and the first line only marks the start.
"""

from __future__ import annotations

from tigas_shaper.traces.builder import TraceBuilder
from tigas_shaper.traces.text import lines, number
from tigas_shaper.traces.trace import NetworkTrace, TraceError


def parse_pensieve(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Each pair of neighbouring lines becomes a state. Raises TraceError."""
    builder = TraceBuilder(name)
    before: float | None = None
    for line, content in lines(text):
        cells = content.split()
        if len(cells) != 2:
            raise TraceError(f"Line {line}: two columns are expected, seconds and Mbit/s, not {len(cells)}.")
        seconds, mbps = number(cells[0], line, "the time"), number(cells[1], line, "the rate")
        if before is not None:
            if seconds <= before:
                raise TraceError(f"Line {line}: time must rise, but {seconds:g} s comes after {before:g} s.")
            builder.add(line, (seconds - before) * 1000, mbps * 1000, up_kbps)
        before = seconds
    return builder.build()
