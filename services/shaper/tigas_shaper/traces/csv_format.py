"""TIGAS's CSV format: `t_ms,down_kbps,up_kbps,delay_ms,jitter_ms,loss_pct`, one line per change (docs/network.md).

An empty cell repeats the previous value. `t_ms` and `down_kbps` are required; other columns have their defaults if they
are absent, or empty before their first value. A last line with only a time marks the end, at which the trace starts
over; without it, the last state is as long as the previous one.
"""

from __future__ import annotations

import re

from tigas_shaper.traces.text import DEFAULT_UP_KBPS, numbered_lines, parse_number, quote, split_cells
from tigas_shaper.traces.trace import NetworkTrace, TraceBuilder, TraceError

VALUES = {"down_kbps": 0.0, "up_kbps": DEFAULT_UP_KBPS, "delay_ms": 0.0, "jitter_ms": 0.0, "loss_pct": 0.0}
"""The columns after `t_ms`, and their defaults."""
ONLY_STEP_MS = 1000
"""Duration of the state in a file with a single line."""
_TIME = re.compile(r"\d{1,15}", re.ASCII)


def parse_csv(name: str, text: str, up_kbps: float = DEFAULT_UP_KBPS) -> NetworkTrace:
    """Parse a trace in this format; `up_kbps` is the default uplink. Raises TraceError."""
    rows = numbered_lines(text)
    first, header = next(rows)
    columns = split_cells(first, header)
    _check_header(first, columns)
    values = {**VALUES, "up_kbps": up_kbps}
    builder = TraceBuilder(name)
    start, lasts, pending = -1, ONLY_STEP_MS, 0  # `pending` is a line without an end yet
    changed = True
    for line, content in rows:
        found = split_cells(line, content)
        if len(found) != len(columns):
            raise TraceError(f"Line {line}: {len(columns)} cells expected, not {len(found)}.")
        row = dict(zip(columns, found, strict=True))
        time = _time(row.pop("t_ms"), line, start)
        if pending:
            lasts = time - start
            builder.add(pending, lasts, **values)
        changed = False
        for column, cell in row.items():
            if cell:
                values[column] = parse_number(cell, line, column)
                changed = True
        if not pending and not row["down_kbps"]:
            raise TraceError(f"Line {line}: the first line must give down_kbps.")
        start, pending = time, line
    if not pending:
        raise TraceError("The file has a header and no line after it.")
    if changed:
        builder.add(pending, lasts, **values)
    return builder.build()


def format_csv(trace: NetworkTrace) -> str:
    """Format a trace; `parse_csv` returns an equal one."""
    out = [",".join(("t_ms", *VALUES))]
    before: tuple[str, ...] = ("",) * len(VALUES)
    for time, state in zip(trace.times_ms, trace.states, strict=True):
        row = tuple(_text(getattr(state, column)) for column in VALUES)
        changes = ("" if cell == last else cell for cell, last in zip(row, before, strict=True))
        out.append(",".join((str(time), *changes)))
        before = row
    out.append(f"{trace.duration_ms}{',' * len(VALUES)}")
    return "\n".join(out) + "\n"


def _check_header(line: int, columns: list[str]) -> None:
    for column in ("t_ms", "down_kbps"):
        if column not in columns:
            raise TraceError(f"Line {line}: the header lacks {column}.")
    for column in columns:
        if column != "t_ms" and column not in VALUES:
            raise TraceError(f"Line {line}: {quote(column)} is not a column of a trace: t_ms, {', '.join(VALUES)}.")
        if columns.count(column) > 1:
            raise TraceError(f"Line {line}: the header has {column} twice.")


def _time(cell: str, line: int, before: int) -> int:
    if not _TIME.fullmatch(cell):
        raise TraceError(f"Line {line}: t_ms must be whole milliseconds from 0, not {quote(cell)}.")
    time = int(cell)
    if before < 0 and time != 0:
        raise TraceError(f"Line {line}: the first t_ms must be 0, not {time}.")
    if time <= before:
        raise TraceError(f"Line {line}: t_ms must increase, but {time} comes after {before}.")
    return time


def _text(value: float) -> str:
    """The shortest text that parses to the same number."""
    return str(int(value)) if value == int(value) else repr(value)
