"""What a trace amounts to: mean, percentiles and outages, weighted by time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tigas_shaper.traces.trace import NetworkTrace

PERCENTILES = (5, 25, 50, 75, 95)


@dataclass(frozen=True, slots=True)
class RateSummary:
    """One direction of a trace, kbit/s."""

    mean: float
    minimum: float
    maximum: float
    percentiles: dict[int, float]
    """By per cent, of PERCENTILES: the rate that the link does not exceed for this share of the time."""


def rate_summary(rates: Sequence[float], steps_ms: Sequence[int]) -> RateSummary:
    """Of rates and how long each lasts."""
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
    mean = sum(rate * step for rate, step in ranked) / total
    return RateSummary(mean, ranked[0][0], ranked[-1][0], percentiles)


def outages(trace: NetworkTrace) -> list[tuple[int, int]]:
    """Start and length, ms, of each time in which nothing passes towards the client."""
    found: list[tuple[int, int]] = []
    for time, state, step in zip(trace.times_ms, trace.states, trace.steps_ms, strict=True):
        if state.down_kbps > 0:
            continue
        if found and sum(found[-1]) == time:
            found[-1] = (found[-1][0], found[-1][1] + step)
        else:
            found.append((time, step))
    return found
