"""The 5G production data set of Cork (Raca et al. 2020): CSV with, among others, Timestamp and DL_bitrate in kbit/s.

About one row a second; stamps repeat and skip, because sampling takes a little more than a second or less. Rows of the
same second are averaged, a skipped second keeps the state before it, and "-" is a value that was not measured, also
kept as before. So a trace lasts as long as its recording did. UL_bitrate is left aside: the phones only downloaded, so
it is the rate of their acknowledgements and no capacity; replayed as one it would choke the link.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from itertools import groupby
from statistics import fmean

from tigas_shaper.traces.text import cells, lines, number, quoted
from tigas_shaper.traces.trace import NetworkTrace, TraceBuilder, TraceError

MISSING = "-"


def parse_irish(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Each second with rows becomes a state. Raises TraceError."""
    builder = TraceBuilder(name)
    begun: tuple[int, datetime] | None = None
    down_kbps: float | None = None
    for stamp, rows in groupby(_rows(text), key=lambda row: row[1]):
        second = list(rows)
        rates = [rate for _, _, rate in second if rate is not None]
        if begun is not None and down_kbps is not None:
            builder.add(begun[0], (stamp - begun[1]) / timedelta(milliseconds=1), down_kbps, up_kbps)
        begun = second[0][0], stamp
        down_kbps = fmean(rates) if rates else down_kbps
    if begun is None or down_kbps is None:
        raise TraceError("No row has a DL_bitrate.")
    builder.add(begun[0], 1000, down_kbps, up_kbps)
    return builder.build()


def _rows(text: str) -> Iterator[tuple[int, datetime, float | None]]:
    """Line, time and DL_bitrate of each row."""
    rows = lines(text)
    first, header = next(rows)
    columns = cells(first, header)
    for column in ("Timestamp", "DL_bitrate"):
        if column not in columns:
            raise TraceError(f"Line {first}: the header lacks {column}.")
    before = datetime.min
    for line, content in rows:
        found = cells(line, content)
        if len(found) < len(columns):
            raise TraceError(f"Line {line}: {len(columns)} cells are expected, not {len(found)}.")
        row = dict(zip(columns, found, strict=False))
        try:
            stamp = datetime.strptime(row["Timestamp"], "%Y.%m.%d_%H.%M.%S")
        except ValueError:
            form = "must look like 2019.12.16_14.23.32, but it is"
            raise TraceError(f"Line {line}: Timestamp {form} {quoted(row['Timestamp'])}.") from None
        if stamp < before:
            raise TraceError(f"Line {line}: time must not go back, but {row['Timestamp']} comes after a later one.")
        before = stamp
        rate = row["DL_bitrate"]
        yield line, stamp, None if rate == MISSING else number(rate, line, "DL_bitrate")
