"""Parsers for the formats of published network recordings; `formats` chooses among them."""

from __future__ import annotations

import json
import math
import re
from array import array
from collections.abc import Iterator
from datetime import datetime, timedelta
from itertools import groupby, islice
from statistics import fmean

from tigas_common.wire.shaper import MAX_DURATION_MS
from tigas_shaper.traces.text import numbered_lines, parse_number, quote, split_cells
from tigas_shaper.traces.trace import MAX_STEPS, NetworkTrace, TraceBuilder, TraceError

MISSING = "-"
PACKET_BITS = 1500 * 8
BIN_MS = 100
"""Bin length for counting Mahimahi's packets: the shortest step at which replay is precise. It covers tens of packets
at LTE rates, so counting whole packets costs little."""
TYPICAL_GAP_MS = 100
"""Packet times are usually closer together than this, rates in kbit/s further apart."""
SAMPLE = 10_000
"""Number of lines that suffice to decide."""
MAX_DECREASING_SHARE = 0.1
"""Share of downward changes that rates exceed and packet times do not. Above 0, so that faulty packet times are
reported by line rather than treated as rates."""


def parse_ghent(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Parse 4G/LTE logs of Ghent (van der Hooft et al. 2016) and 3G logs of Norway (Riiser et al. 2013).

    Six columns: time stamp, ms since the start, latitude, longitude, BYTES received since the previous line, ms since
    the previous line. So kbit/s = bytes × 8 / ms. A well-known copy of these logs has kilobytes per second instead, and
    is replayed at one eighth of the recorded rate. Raises TraceError.
    """
    builder = TraceBuilder(name)
    before = 0.0
    for line, content in numbered_lines(text):
        cells = content.split()
        if len(cells) != 6:
            raise TraceError(f"Line {line}: a Ghent 4G log has 6 columns, not {len(cells)}.")
        elapsed = parse_number(cells[1], line, "the time since the start")
        received, interval = parse_number(cells[4], line, "the bytes"), parse_number(cells[5], line, "the interval")
        if elapsed < before:
            raise TraceError(f"Line {line}: time must not go back, but {elapsed:g} ms comes after {before:g} ms.")
        if interval == 0:
            raise TraceError(f"Line {line}: the interval must not be 0 ms.")
        builder.add(line, interval, received * 8 / interval, up_kbps)
        before = elapsed
    return builder.build()


def parse_pensieve(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Parse lines of "seconds Mbit/s": the Norwegian, FCC and Puffer sets in Pensieve (Mao et al. 2017) and later work.

    As in Pensieve's simulator, a line's rate was measured since the previous line and applies from there to its own
    time; the first line only marks the start. Raises TraceError.
    """
    builder = TraceBuilder(name)
    before: float | None = None
    for line, content in numbered_lines(text):
        cells = content.split()
        if len(cells) != 2:
            raise TraceError(f"Line {line}: two columns are expected, seconds and Mbit/s, not {len(cells)}.")
        seconds, mbps = parse_number(cells[0], line, "the time"), parse_number(cells[1], line, "the rate")
        if before is not None:
            if seconds <= before:
                raise TraceError(f"Line {line}: time must increase, but {seconds:g} s comes after {before:g} s.")
            builder.add(line, (seconds - before) * 1000, mbps * 1000, up_kbps)
        before = seconds
    return builder.build()


def parse_plain(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Parse a plain list of rates in kbit/s, one per second. Raises TraceError."""
    builder = TraceBuilder(name)
    for line, rate in _column(text):
        builder.add(line, 1000, rate, up_kbps)
    return builder.build()


def parse_mahimahi(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Parse Mahimahi's packet-delivery trace (Winstein et al. 2013; Netravali et al. 2015). Raises TraceError.

    Each line is the millisecond at which one packet of 1500 bytes may pass. The last one is also the end, at which the
    trace starts over. The rate of a bin is its packets over its length.
    """
    packets = array("q")
    """Number of packets in each bin."""
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
    if end < BIN_MS:  # in a pattern such as the single line "1", 12 Mbit/s, only the mean matters
        builder.add(line, BIN_MS, packets[0] * PACKET_BITS / end, up_kbps)
        return builder.build()
    if end % BIN_MS == 0:  # packets at the very end belong to the last bin
        last = packets.pop()
        packets[-1] += last
    for index, count in enumerate(packets):
        lasts = min(BIN_MS, end - index * BIN_MS)
        builder.add(line, lasts, count * PACKET_BITS / lasts, up_kbps)
    return builder.build()


def is_packet_times(text: str) -> bool:
    """Whether the numbers are Mahimahi's milliseconds: whole, hardly ever decreasing, and mostly close together."""
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
    return near >= far and near + far > 0 and falls <= MAX_DECREASING_SHARE * (near + far)


def _column(text: str) -> Iterator[tuple[int, float]]:
    """Line number and value of each line."""
    for line, content in numbered_lines(text):
        # Fast path for plain digits, as a 5G link passes a hundred thousand packets per second.
        quick = len(content) < 16 and content.isascii() and content.isdigit()
        yield line, float(content) if quick else parse_number(content, line, "each line of this file")


def parse_irish(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Parse the 5G data set of Cork (Raca et al. 2020): CSV with columns such as Timestamp and DL_bitrate in kbit/s.

    About one row per second; time stamps repeat and skip, as the sampling interval varies around a second. Rows of the
    same second are averaged, a skipped second keeps the previous state, and "-" is an unmeasured value, also kept as
    before, so that a trace lasts as long as its recording. UL_bitrate is ignored: the phones only downloaded, so it is
    the rate of their acknowledgements and not a capacity. Raises TraceError.
    """
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
    rows = numbered_lines(text)
    first, header = next(rows)
    columns = split_cells(first, header)
    for column in ("Timestamp", "DL_bitrate"):
        if column not in columns:
            raise TraceError(f"Line {first}: the header lacks {column}.")
    before = datetime.min
    for line, content in rows:
        found = split_cells(line, content)
        if len(found) < len(columns):
            raise TraceError(f"Line {line}: {len(columns)} cells expected, not {len(found)}.")
        row = dict(zip(columns, found, strict=False))
        try:
            stamp = datetime.strptime(row["Timestamp"], "%Y.%m.%d_%H.%M.%S")
        except ValueError:
            form = "must look like 2019.12.16_14.23.32, but it is"
            raise TraceError(f"Line {line}: Timestamp {form} {quote(row['Timestamp'])}.") from None
        if stamp < before:
            raise TraceError(f"Line {line}: time must not go back, but {row['Timestamp']} comes after a later one.")
        before = stamp
        rate = row["DL_bitrate"]
        yield line, stamp, None if rate == MISSING else parse_number(rate, line, "DL_bitrate")


_BEGIN = re.compile(r"\s*\[\s*")
_PERIOD = re.compile(r"(\{[^{}]{0,1000}\})\s*[,\]]\s*")
"""One period. Periods are flat, so that a hostile file cannot build a deep or large structure."""


def parse_sabre(name: str, text: str, up_kbps: float) -> NetworkTrace:
    """Parse Sabre's JSON (Spiteri et al. 2018): a list of {duration_ms, bandwidth_kbps, latency_ms}.

    Sabre's latency is the time from a request to the first bit of its answer, hence a round trip; our one-way delay is
    half of it. Raises TraceError.
    """
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
                raise TraceError(f"Line {line}: unexpected text after the end of the list.")
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
        raise TraceError(f"Line {line}: {key} must be a non-negative number.")
    return value
