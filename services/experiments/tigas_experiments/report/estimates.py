"""Means over blocks with their range and bootstrap confidence intervals, and paired differences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self, TypeVar

import numpy as np
from scipy.stats import bootstrap

from tigas_experiments.report.metrics import Metric

LEAST_BLOCKS = 6
"""Minimum for an interval: with fewer, equal signs of all blocks occur by chance in more than 5 % of cases."""
RESAMPLES = 5000
SEED = 1
Key = TypeVar("Key")


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean over blocks with its 95 % bootstrap confidence interval."""

    mean: float
    low: float
    """Lowest value of the runs or, without them, the blocks."""
    high: float
    blocks: int
    interval: tuple[float, float] | None
    """None with fewer than LEAST_BLOCKS."""

    @classmethod
    def over(cls, blocks: Sequence[float], step: float = 0.0, runs: Sequence[float] = ()) -> Self | None:
        """Estimate from one value per block; None without blocks. One infinite value makes the mean infinite.

        `step` is the resolution of each value, which widens the interval of equal values.
        """
        if not blocks:
            return None
        low, high = min(runs or blocks), max(runs or blocks)
        mean = sum(blocks) / len(blocks)  # nan for inf and -inf
        interval = _interval(tuple(blocks), step) if len(blocks) >= LEAST_BLOCKS else None
        # Rounding must not move the mean of equal values outside their range.
        return cls(min(max(mean, low), high), low, high, len(blocks), interval)

    @property
    def certain(self) -> bool:
        """Whether the interval excludes zero."""
        return self.interval is not None and (self.interval[0] > 0 or self.interval[1] < 0)

    def interval_text(self, metric: Metric) -> str:
        """The formatted interval; empty without one."""
        if self.interval is None:
            return ""
        low, high = (signed(metric, value) if math.isinf(value) else metric.text(value) for value in self.interval)
        return f"[{low}, {high}]"

    def range_text(self, metric: Metric) -> str:
        """The formatted range; empty for equal values."""
        low, high = metric.text(self.low), metric.text(self.high)
        return "" if low == high else f"{low}–{high}"


def signed(metric: Metric, difference: float) -> str:
    """A formatted difference; infinite if only one side was ever reached."""
    if math.isnan(difference):
        return metric.text(None)
    if math.isinf(difference):
        return "−∞" if difference < 0 else "∞"
    return f"{'+' * (difference > 0)}{metric.text(difference)}"


def paired(one: Mapping[Key, float], other: Mapping[Key, float]) -> dict[Key, float]:
    """Difference `one - other` in each common block; 0 for equal values, including two infinite ones."""
    return {block: 0.0 if one[block] == other[block] else one[block] - other[block] for block in one if block in other}


@lru_cache(100_000)
def _interval(values: tuple[float, ...], step: float) -> tuple[float, float]:
    """Percentile bootstrap with fixed resamples; half a step to both sides of equal, nonzero values.

    An infinite value makes its end of the interval infinite. For the other end it counts as the outermost finite value,
    which is conservative.
    """
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return min(values), max(values)
    clipped = np.clip(values, min(finite), max(finite))
    if np.ptp(clipped) == 0:
        half = step / 2 if finite[0] != 0 else 0.0
        low, high = finite[0] - half, finite[0] + half
    else:
        rng = np.random.default_rng(SEED)
        found = bootstrap((clipped,), np.mean, n_resamples=RESAMPLES, method="percentile", rng=rng)
        low, high = map(float, found.confidence_interval)
    return min(low, min(values)) if -math.inf in values else low, math.inf if math.inf in values else high
