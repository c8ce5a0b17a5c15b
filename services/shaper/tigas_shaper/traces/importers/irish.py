"""The 5G production data set of Cork (Raca et al. 2020): CSV with, among others, Timestamp and DL_bitrate in kbit/s.

About one row a second; stamps repeat and skip, because sampling takes a little more than a second or less. Rows of the
same second are averaged, a skipped second keeps the state before it, and "-" is a value that was not measured, also
kept as before. So a trace lasts as long as its recording did. UL_bitrate is left aside: the phones only downloaded, so
it is the rate of their acknowledgements and no capacity; replayed as one it would choke the link.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from itertools import dropwhile
from statistics import fmean

from tigas_shaper.traces.builder import TraceBuilder
from tigas_shaper.traces.text import lines, number, quoted
from tigas_shaper.traces.trace import NetworkTrace, TraceError

MISSING = "-"


def parse_irish(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Each second with rows becomes a state. Raises TraceError."""
    rows = lines(text)
    first, header = next(rows)
    columns = _cells(first, header)
    for column in ("Timestamp", "DL_bitrate"):
        if column not in columns:
            raise TraceError(f"Line {first}: the header lacks {column}.")
    stamp_at, down_at = columns.index("Timestamp"), columns.index("DL_bitrate")

    seconds: list[_Second] = []
    for line, content in rows:
        cells = _cells(line, content)
        if len(cells) < len(columns):
            raise TraceError(f"Line {line}: {len(columns)} cells are expected, not {len(cells)}.")
        stamp = _stamp(cells[stamp_at], line)
        if seconds and stamp < seconds[-1].stamp:
            raise TraceError(f"Line {line}: time must not go back, but {cells[stamp_at]} comes after a later one.")
        if not seconds or stamp > seconds[-1].stamp:
            seconds.append(_Second(line, stamp))
        if cells[down_at] != MISSING:
            seconds[-1].down.append(number(cells[down_at], line, "DL_bitrate"))

    measured = list(dropwhile(lambda second: not second.down, seconds))
    if not measured:
        raise TraceError("No row has a DL_bitrate.")
    builder = TraceBuilder(name)
    down_kbps = 0.0
    for second, after in zip(measured, [*measured[1:], None], strict=True):
        down_kbps = fmean(second.down) if second.down else down_kbps
        lasts = after.stamp - second.stamp if after else timedelta(seconds=1)
        builder.add(second.line, lasts.total_seconds() * 1000, down_kbps, up_kbps)
    return builder.build()


@dataclass(slots=True)
class _Second:
    """The rates of one second, and the line of the first."""

    line: int
    stamp: datetime
    down: list[float] = field(default_factory=list)


def _cells(line: int, content: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([content], strict=True))]
    except csv.Error:
        raise TraceError(f"Line {line}: the quotes do not match.") from None


def _stamp(cell: str, line: int) -> datetime:
    try:
        return datetime.strptime(cell, "%Y.%m.%d_%H.%M.%S")
    except ValueError:
        raise TraceError(
            f"Line {line}: Timestamp must look like 2019.12.16_14.23.32, but it is {quoted(cell)}."
        ) from None
