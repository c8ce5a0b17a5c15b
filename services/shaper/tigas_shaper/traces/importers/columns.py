"""Recordings in columns of numbers, separated by blanks. Those with a single column look alike: their values decide."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from itertools import islice

from tigas_common.wire.shaper import MAX_DURATION_MS
from tigas_shaper.traces.text import lines, number
from tigas_shaper.traces.trace import MAX_STEPS, NetworkTrace, TraceBuilder, TraceError

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


def parse_ghent(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """4G/LTE logs of Ghent (van der Hooft et al. 2016), and 3G logs of Norway (Riiser et al. 2013) in their own format.

    Six columns: time stamp, ms since the start, latitude, longitude, BYTES received since the line before, ms since the
    line before. So kbit/s = bytes × 8 / ms; a well-known copy of these logs holds kilobytes per second instead and is
    replayed at one eighth of the recorded rate. Raises TraceError.
    """
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


def parse_pensieve(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Lines of "seconds Mbit/s", as the Norwegian, FCC and Puffer sets in Pensieve (Mao et al. 2017) and later work.

    As in Pensieve's simulator, a line's rate was measured since the previous line, so it applies from there to its own
    time, and the first line only marks the start. Raises TraceError.
    """
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


def parse_plain(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """A plain list of rates in kbit/s, one a second. Raises TraceError."""
    builder = TraceBuilder(name)
    for line, rate in _column(text):
        builder.add(line, 1000, rate, up_kbps)
    return builder.build()


def parse_mahimahi(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Mahimahi's packet-delivery trace (Winstein et al. 2013; Netravali et al. 2015). Raises TraceError.

    Each line is the millisecond at which one packet of 1500 bytes may pass. The last is also the end, where the trace
    starts again. The rate of a bin is its packets over its length.
    """
    packets = array("q")
    """In each bin."""
    end = line = 0
    for line, stamp in _column(text):
        if stamp != int(stamp):
            raise TraceError(f"Line {line}: a Mahimahi trace holds whole milliseconds, not {stamp:g}.")
        if stamp < end:
            raise TraceError(f"Line {line}: time must not go back, but {stamp:.0f} ms comes after {end} ms.")
        if stamp > MAX_DURATION_MS:
            raise TraceError(f"Line {line}: a trace may last 30 days; this one lasts longer.")
        end = int(stamp)
        if end > BIN_MS * MAX_STEPS:
            raise TraceError(f"Line {line}: a trace may have {MAX_STEPS:,} steps; this one has more.")
        packets.extend([0] * (end // BIN_MS + 1 - len(packets)))
        packets[-1] += 1
    if end == 0:
        raise TraceError(f"Line {line}: a Mahimahi trace must end after 0 ms.")
    builder = TraceBuilder(name)
    if end < BIN_MS:  # a pattern such as the one line "1", 12 Mbit/s: only its mean matters
        builder.add(line, BIN_MS, packets[0] * PACKET_BITS / end, up_kbps)
        return builder.build()
    if end % BIN_MS == 0:  # packets at the very end belong to the last bin
        last = packets.pop()
        packets[-1] += last
    for index, count in enumerate(packets):
        lasts = min(BIN_MS, end - index * BIN_MS)
        builder.add(line, lasts, count * PACKET_BITS / lasts, up_kbps)
    return builder.build()


def holds_packet_times(text: str) -> bool:
    """Whether these are Mahimahi's milliseconds: whole, hardly ever falling, and mostly close together."""
    near = far = falls = 0
    before = 0.0
    for _, value in islice(_column(text), SAMPLE):
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


def _column(text: str) -> Iterator[tuple[int, float]]:
    """Line and number of each line."""
    for line, content in lines(text):
        # the quick way for plain digits: a 5G link passes a hundred thousand packets a second
        quick = len(content) < 16 and content.isascii() and content.isdigit()
        yield line, float(content) if quick else number(content, line, "each line of this file")
