"""Puts the recordings of two directions together into one trace."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.trace import MAX_STEPS, NetworkTrace, TraceError


def combine(down: NetworkTrace, up: NetworkTrace) -> NetworkTrace:
    """`down` with the rates of `up`, a recording of the other direction, as its uplink; it repeats if it is shorter.

    Mahimahi, for one, publishes the two directions as two files. Raises TraceError.
    """
    times: list[int] = []
    states: list[LinkSetting] = []
    time = 0
    while time < down.duration_ms:
        if len(times) == MAX_STEPS:
            raise TraceError(f"A trace may have {MAX_STEPS:,} steps; the two together have more.")
        times.append(time)
        states.append(replace(down.at(time), up_kbps=up.at(time).down_kbps))
        time = min(_next_change(down, time), _next_change(up, time))
    return NetworkTrace(down.name, tuple(times), tuple(states), down.duration_ms)


def _next_change(trace: NetworkTrace, time: int) -> int:
    turn, within = divmod(time, trace.duration_ms)
    index = bisect_right(trace.times_ms, within)
    return turn * trace.duration_ms + (trace.times_ms[index] if index < len(trace.times_ms) else trace.duration_ms)
