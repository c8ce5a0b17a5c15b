"""Files with one number per line: Mahimahi's packet times, or plain rates. They look alike, so their values decide."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from itertools import islice

from tigas_common.wire.shaper import MAX_DURATION_MS
from tigas_shaper.traces.builder import TraceBuilder
from tigas_shaper.traces.text import lines, number
from tigas_shaper.traces.trace import NetworkTrace, TraceError

PACKET_BITS = 1500 * 8
BIN_MS = 100
"""Mahimahi's packets are counted in bins of this length: the shortest step at which replay is precise, and tens of
packets at LTE rates, so that counting whole packets costs little."""
TYPICAL_GAP_MS = 100
"""Packet times are usually closer together than this, rates in kbit/s further apart."""
SAMPLE = 10_000
"""Number of lines that suffice to decide."""
FEW_FALLS = 0.1
"""The share of changes downwards that rates have and packet times do not. Above 0, so that packet times with a fault
are refused by line and not taken for rates."""
WHAT = "each line of this file"


@dataclass(slots=True)
class Column:
    """The numbers of a file with their line numbers. Arrays, because there may be millions of packet times."""

    lines: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))


def read_column(text: str, limit: int | None = None) -> Column:
    """The first `limit` numbers, or all. Raises TraceError where a line is not one number."""
    column = Column()
    for line, content in islice(lines(text), limit):
        # the quick way for plain digits: a 5G link passes a hundred thousand packets a second
        quick = len(content) < 16 and content.isascii() and content.isdigit()
        column.values.append(float(content) if quick else number(content, line, WHAT))
        column.lines.append(line)
    return column


def holds_packet_times(text: str) -> bool:
    """Whether these are Mahimahi's milliseconds: whole, hardly ever falling, and mostly close together."""
    column = read_column(text, SAMPLE)
    near = far = falls = 0
    before = 0.0
    for value in column.values:
        if value != int(value):
            return False
        if value != before:
            falls += value < before
            if abs(value - before) <= TYPICAL_GAP_MS:
                near += 1
            else:
                far += 1
        before = value
    return near >= far and near + far > 0 and falls <= FEW_FALLS * (near + far)


def parse_plain(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """A plain list of rates in kbit/s, one a second. Raises TraceError."""
    builder = TraceBuilder(name)
    for line, content in lines(text):
        builder.add(line, 1000, number(content, line, WHAT), up_kbps)
    return builder.build()


def parse_mahimahi(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Mahimahi's packet-delivery trace (Winstein et al. 2013; Netravali et al. 2015). Raises TraceError.

    Each line is the millisecond at which one packet of 1500 bytes may pass. The last is also the end, where the trace
    starts again. The rate of a bin is its packets over its length.
    """
    column = read_column(text)
    before = 0.0
    for line, stamp in zip(column.lines, column.values, strict=True):
        if stamp != int(stamp):
            raise TraceError(f"Line {line}: a Mahimahi trace holds whole milliseconds, not {stamp:g}.")
        if stamp < before:
            raise TraceError(f"Line {line}: time must not go back, but {stamp:.0f} ms comes after {before:.0f} ms.")
        before = stamp
    last_line, end = column.lines[-1], int(before)
    if end == 0:
        raise TraceError(f"Line {last_line}: a Mahimahi trace must end after 0 ms.")
    if end > MAX_DURATION_MS:
        raise TraceError(f"Line {last_line}: a trace may last 30 days; this one lasts longer.")

    builder = TraceBuilder(name)
    if end < BIN_MS:  # a pattern such as the one line "1", 12 Mbit/s: only its mean matters
        builder.add(last_line, BIN_MS, len(column.values) * PACKET_BITS / end, up_kbps)
        return builder.build()
    position = 0
    for start in range(0, end, BIN_MS):
        stop, first = min(start + BIN_MS, end), position
        # a packet at the very end belongs to the last bin
        while position < len(column.values) and (column.values[position] < stop or stop == end):
            position += 1
        line = column.lines[max(position - 1, 0)]
        builder.add(line, stop - start, (position - first) * PACKET_BITS / (stop - start), up_kbps)
    return builder.build()
