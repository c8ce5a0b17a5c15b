"""Which parts of network traces and movements an experiment's runs use: many different ones, chosen by the seed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from random import Random

from tigas_common.errors import StartError
from tigas_common.files import read_regular
from tigas_common.wire.shaper import MAX_UPLOAD_BYTES
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.wire.run import Network


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
    """Start times (s) of `count` parts of a trace, in order, from `begin_s` on and without overlap.

    Durations of traces without a file are in `traces_s`. Raises StartError if the trace is too short, its duration is
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
    return [begin_s + offset for offset in _apart(end_s - begin_s, length_s, count, Random(f"{seed} {network.name}"))]


def movement_offsets(movement: str, directory: Path, *, length_s: float, count: int, seed: int) -> list[float]:
    """Where `count` parts of a movement begin, s, in random order; they overlap where its file is too short for all.

    A generated movement is as long as all parts together. Raises StartError if the file is no movement, or shorter than
    one part.
    """
    path = directory / movement
    chance = Random(f"{seed} {Path(movement).name}")
    total_s = MovementTrace.read(path).duration_ms / 1000 if path.is_file() else length_s * count
    if total_s < length_s:
        raise StartError(f"The movement {movement} lasts {total_s:.1f} s, less than a run's {length_s:g} s.")
    if total_s >= length_s * count:
        offsets = _apart(total_s, length_s, count, chance)
    else:
        offsets = [_milliseconds(place * (total_s - length_s) / (count - 1)) for place in range(count)]
    chance.shuffle(offsets)
    return offsets


def _apart(total_s: float, length_s: float, count: int, chance: Random) -> list[float]:
    """Parts that do not overlap, uniformly among all ways to place them."""
    spare = total_s - length_s * count
    gaps = sorted(chance.uniform(0, spare) for _ in range(count))
    return [_milliseconds(place * length_s + gap) for place, gap in enumerate(gaps)]


def _milliseconds(seconds: float) -> float:
    """Round down to whole milliseconds, so that a part ends before its source."""
    return int(seconds * 1000) / 1000


def _trace_duration_s(path: Path) -> float:
    """Duration of a TIGAS trace, whose last row is its end (docs/network.md)."""
    try:
        text = read_regular(path, MAX_UPLOAD_BYTES).decode("utf-8", errors="replace")
    except OSError as error:
        raise StartError(f"{path} cannot be read: {error.strerror or error}.") from None
    head, *rows = [line for line in text.splitlines() if line and not line.startswith("#")] or [""]
    end_ms = rows[-1].split(",")[0] if rows else ""
    if not head.startswith("t_ms,down_kbps") or not re.fullmatch("[0-9]{1,15}", end_ms):
        raise StartError(f"{path} is not a TIGAS trace, which segments need; convert it with `tigas trace import`.")
    return int(end_ms) / 1000
