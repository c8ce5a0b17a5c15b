"""Helpers of trace readers: bounded reading, numbered lines, and cells as numbers.

All of them raise TraceError with one sentence that names the line.
"""

from __future__ import annotations

import csv
import gzip
import io
import math
import re
import zlib
from collections.abc import Iterator
from pathlib import Path

from tigas_common.files import open_regular
from tigas_shaper.traces.trace import TraceError

MAX_BYTES = 64_000_000
"""Maximum size, uncompressed. The longest published recordings have a few megabytes."""
MAX_LINE = 10_000
"""Characters; bounds the cost of splitting one hostile line."""
DEFAULT_UP_KBPS = 10_000.0
"""Uplink if only the downlink was recorded: a usual 4G uplink, and far more than poses and ACKs need, so that the
recorded direction remains the bottleneck."""

_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)


def read_bounded(path: Path) -> bytes:
    """Read a file's bytes, up to the limit. Raises TraceError if it is larger, and OSError."""
    with open_regular(path) as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise _size_error()
    return data


def decode(data: bytes) -> str:
    """The text of a trace file, decompressed if it is gzip."""
    if data.startswith(b"\x1f\x8b"):
        try:
            # reading one byte over the limit detects larger files, so a bomb costs no more than the limit
            data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(MAX_BYTES + 1)
        except (OSError, EOFError, zlib.error):
            raise TraceError("The gzip file is damaged or cut short.") from None
    if len(data) > MAX_BYTES:
        raise _size_error()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise TraceError("The file is binary, not the text of a network trace.") from None
    if "\0" in text:
        raise TraceError("The file is binary, not the text of a network trace.")
    if not text or text.isspace():
        raise TraceError("The file is empty.")
    return text


def numbered_lines(text: str) -> Iterator[tuple[int, str]]:
    """Number and content of each non-blank line."""
    for line, content in enumerate(io.StringIO(text, newline=None), 1):
        if len(content) > MAX_LINE:
            raise TraceError(f"Line {line} is longer than {MAX_LINE:,} characters.")
        stripped = content.strip()
        if stripped:
            yield line, stripped


def split_cells(line: int, content: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([content], strict=True))]
    except csv.Error:
        raise TraceError(f"Line {line}: the quotes do not match.") from None


def quote(cell: str) -> str:
    """A cell in quotes, truncated, for a message."""
    return repr(cell if len(cell) <= 30 else cell[:29] + "…")


def parse_number(cell: str, line: int, what: str) -> float:
    """Parse a cell as a finite, non-negative number in plain decimal notation: not NaN, 1_000 or non-ASCII digits."""
    cell = cell.strip()
    if len(cell) > 40 or not _NUMBER.fullmatch(cell):
        raise TraceError(f"Line {line}: {what} must be a number, not {quote(cell)}.")
    value = float(cell)
    if not math.isfinite(value):
        raise TraceError(f"Line {line}: {what} is too large: {quote(cell)}.")
    if value < 0:
        raise TraceError(f"Line {line}: {what} must not be negative, but is {quote(cell)}.")
    return value


def _size_error() -> TraceError:
    return TraceError(f"The file is larger than {MAX_BYTES // 1_000_000} MB, too large for a network trace.")
