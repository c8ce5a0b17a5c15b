"""Summary of a trace: percentiles of its rates, weighted by time, and its outages."""

from __future__ import annotations

from collections.abc import Sequence

from tigas_shaper.traces.trace import NetworkTrace

PERCENTILES = (5, 25, 50, 75, 95)


def rate_percentiles(rates: Sequence[float], steps_ms: Sequence[int]) -> dict[int, float]:
    """By per cent, of PERCENTILES: the rate that the link does not exceed for this share of the time.

    Of rates and how long each lasts.
    """
    total = sum(steps_ms)
    ranked = sorted(zip(rates, steps_ms, strict=True))
    percentiles = {}
    for percent in PERCENTILES:
        passed = 0
        for rate, step in ranked:
            passed += step
            if passed * 100 >= percent * total:
                percentiles[percent] = rate
                break
    return percentiles


def outages(trace: NetworkTrace) -> list[tuple[int, int]]:
    """Start and length in ms of each period without downlink capacity."""
    found: list[tuple[int, int]] = []
    for time, state, step in zip(trace.times_ms, trace.states, trace.steps_ms, strict=True):
        if state.down_kbps > 0:
            continue
        if found and sum(found[-1]) == time:
            found[-1] = (found[-1][0], found[-1][1] + step)
        else:
            found.append((time, step))
    return found
