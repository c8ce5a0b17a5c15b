"""The parts of network traces and movements that an experiment's runs use, chosen by the seed."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path
from random import Random

from tigas_common.errors import StartError
from tigas_common.files import read_regular
from tigas_common.wire.shaper import MAX_UPLOAD_BYTES
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.wire.run import Network

ONLY_STEP_MS = 1000
"""Duration of a trace with a single row."""
_TIME = re.compile("[0-9]{1,15}")


def trace_offsets(
    network: Network,
    directory: Path,
    traces_s: Mapping[str, float],
    *,
    begin_s: float,
    length_s: float,
    count: int,
    seed: int,
) -> list[float]:
    """Start times (s) of `count` non-overlapping parts of a trace, in order, at or after `begin_s`.

    `traces_s` has durations of traces without a file. Raises StartError if the trace is too short, its duration is
    unknown, or its file is not a TIGAS trace.
    """
    if network.trace_file is not None:
        end_s = _trace_duration_s(directory / network.trace_file)
    elif network.name in traces_s:
        end_s = traces_s[network.name]
    else:
        raise StartError(f"Segments need the trace's file, so {network.name!r} must be a path.")
    room = int((end_s - begin_s) / length_s)
    if room < count:
        raise StartError(
            f"{network.name} has room for {max(0, room)} segments of {length_s:g} s from {begin_s:g} s on, not {count}."
        )
    return [begin_s + offset for offset in _starts(end_s - begin_s, length_s, count, Random(f"{seed} {network.name}"))]


def movement_offsets(movement: str, directory: Path, *, length_s: float, count: int, seed: int) -> list[float]:
    """Start times (s) of `count` parts of a movement, in random order; they overlap if its file is too short for all.

    A generated movement is as long as all parts together. Raises StartError if the file is not a movement, or is
    shorter than one part.
    """
    path = directory / movement
    rng = Random(f"{seed} {Path(movement).name}")
    total_s = MovementTrace.read(path).duration_ms / 1000 if path.is_file() else length_s * count
    if total_s < length_s:
        raise StartError(f"The movement {movement} lasts {total_s:.1f} s, less than a run's {length_s:g} s.")
    if total_s >= length_s * count:
        offsets = _starts(total_s, length_s, count, rng)
    else:
        offsets = [_milliseconds(place * (total_s - length_s) / (count - 1)) for place in range(count)]
    rng.shuffle(offsets)
    return offsets


def _starts(total_s: float, length_s: float, count: int, rng: Random) -> list[float]:
    """Start times of parts that do not overlap, uniformly distributed over all possible placements."""
    spare = total_s - length_s * count
    gaps = sorted(rng.uniform(0, spare) for _ in range(count))
    return [_milliseconds(place * length_s + gap) for place, gap in enumerate(gaps)]


def _milliseconds(seconds: float) -> float:
    """Round down to whole milliseconds, so that a part ends before its source."""
    return int(seconds * 1000) / 1000


def _trace_duration_s(path: Path) -> float:
    """Duration of a TIGAS trace, up to its end mark or, without one, the end of its last state (docs/network.md)."""
    try:
        text = read_regular(path, MAX_UPLOAD_BYTES).decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise StartError(f"{path} cannot be read: {error.strerror or error}.") from None
    rows = list(csv.DictReader(filter(None, map(_compact, text.splitlines()))))
    times = [row.pop("t_ms", None) or "" for row in rows]
    if not rows or "down_kbps" not in rows[0] or not all(map(_TIME.fullmatch, times)):
        raise StartError(f"{path} is not a TIGAS trace, which segments need; convert it with `tigas trace import`.")
    end_ms = int(times[-1])
    if any(rows[-1].values()):
        end_ms += end_ms - int(times[-2]) if len(times) > 1 else ONLY_STEP_MS
    return end_ms / 1000


def _compact(line: str) -> str:
    return "".join(line.split())
