"""Means over blocks, with confidence intervals that generalise to other networks and people, and paired differences.

Blocks that share a network window or a person are not independent. Intervals come from the variance of the mean,
clustered by both (Cameron, Gelbach & Miller, J. Business & Economic Statistics 29, 2011), and Student's t with
Satterthwaite's degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from tigas_experiments.report.metrics import Metric
from tigas_experiments.report.run_table import Block

MIN_WINDOWS = 12
"""Minimum number of network windows for an interval: with fewer, it covers the true mean too rarely."""
MIN_PEOPLE = 6
"""Minimum number of people for intervals to generalise to others, as their variance cannot be estimated from fewer."""
CONFIDENCE = 0.95
Key = TypeVar("Key")


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean over blocks with its 95 % confidence interval."""

    mean: float
    low: float
    """Lowest value of the runs or, without runs, of the blocks."""
    high: float
    blocks: int
    interval: tuple[float, float] | None = None
    """None with fewer than LEAST_WINDOWS windows."""
    p: float | None = None
    """Probability of a mean at least this far from zero if the true mean is zero; None without an interval."""

    @classmethod
    def from_blocks(cls, blocks: Mapping[Block, float], step: float = 0.0, runs: Sequence[float] = ()) -> Self | None:
        """Estimate from one value per block; None without blocks. One infinite value makes the mean infinite.

        `step` is the resolution of each value, which widens the interval of equal values.
        """
        found = cls.from_means([*blocks.values()], runs)
        if found is None:
            return None
        interval, p = _interval(tuple(sorted(blocks.items())), step) or (None, None)
        return cls(found.mean, found.low, found.high, len(blocks), interval, p)

    @classmethod
    def from_means(cls, values: Sequence[float], runs: Sequence[float] = ()) -> Self | None:
        """Only mean and range; None without values."""
        if not values:
            return None
        low, high = min(runs or values), max(runs or values)
        mean = sum(values) / len(values)  # nan for inf and -inf
        # Rounding must not move the mean of equal values out of their range.
        return cls(min(max(mean, low), high), low, high, len(values))

    def interval_text(self, metric: Metric) -> str:
        """The formatted interval; empty without one."""
        if self.interval is None:
            return ""
        low, high = (signed_text(metric, value) if math.isinf(value) else metric.text(value) for value in self.interval)
        return f"[{low}, {high}]"

    def range_text(self, metric: Metric) -> str:
        """The formatted range; empty for equal values."""
        low, high = metric.text(self.low), metric.text(self.high)
        return "" if low == high else f"{low}–{high}"


def significant(estimates: Iterable[Estimate | None]) -> Collection[Estimate]:
    """Estimates in one table that differ from zero, with at most 5 % chance of any false one (Holm 1979)."""
    claims = sorted((found for found in estimates if found and found.p is not None), key=lambda found: found.p or 0)
    sure: list[Estimate] = []
    for place, claim in enumerate(claims):
        if claim.p is None or claim.p > (1 - CONFIDENCE) / (len(claims) - place):
            break
        sure.append(claim)
    return sure


def signed_text(metric: Metric, difference: float) -> str:
    """A formatted difference; infinite if only one side was ever reached."""
    if math.isnan(difference):
        return metric.text(None)
    if math.isinf(difference):
        return "−∞" if difference < 0 else "∞"
    return f"{'+' * (difference > 0)}{metric.text(difference)}"


def differences(one: Mapping[Key, float], other: Mapping[Key, float]) -> dict[Key, float]:
    """Difference `one - other` in each common block; 0 for equal values, including two infinite ones."""
    return {block: 0.0 if one[block] == other[block] else one[block] - other[block] for block in one if block in other}


class _Clusters(NamedTuple):
    variance: float
    """Variance of the mean."""
    number: int


@lru_cache(100_000)
def _interval(blocks: tuple[tuple[Block, float], ...], step: float) -> tuple[tuple[float, float], float] | None:
    """Interval of the mean, and the p-value of a zero mean; None with too few windows.

    Equal, nonzero values get half a step on both sides. An infinite value makes its end of the interval infinite. For
    the other end it counts as the outermost finite value, which is conservative.
    """
    windows, people = [block.window for block, _ in blocks], [block.movement for block, _ in blocks]
    if len(set(windows)) < MIN_WINDOWS:
        return None
    values = [value for _, value in blocks]
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return (min(values), max(values)), float(min(values) != max(values))
    clipped = np.clip(values, min(finite), max(finite))
    mean = float(clipped.mean())
    if np.ptp(clipped) == 0:
        half = step / 2 if mean != 0 else 0.0
        p = float(abs(mean) <= half)
    else:
        error, freedom = _standard_error(clipped - mean, windows, people)
        half = float(student.ppf((1 + CONFIDENCE) / 2, freedom)) * error
        p = float(2 * student.sf(abs(mean) / error, freedom)) if error > 0 else float(mean == 0)
    low = min(mean - half, min(values)) if -math.inf in values else mean - half
    high = math.inf if math.inf in values else mean + half
    return (low, high), p if len(finite) == len(values) or not low <= 0 <= high else 1.0


def _standard_error(
    residuals: NDArray[np.float64], windows: Sequence[Hashable], people: Sequence[Hashable]
) -> tuple[float, float]:
    """Standard error of the mean, and its degrees of freedom."""
    by_window, by_person = _clusters(residuals, windows), _clusters(residuals, people)
    if by_person.number < MIN_PEOPLE:
        return math.sqrt(by_window.variance), by_window.number - 1
    both = _clusters(residuals, [*zip(windows, people, strict=True)])
    sides = (by_window, by_person)
    variance = max(by_window.variance + by_person.variance - both.variance, *(side.variance for side in sides))
    spread = sum(side.variance**2 / (side.number - 1) for side in sides)
    return math.sqrt(variance), variance**2 / spread if spread else by_window.number - 1


def _clusters(residuals: NDArray[np.float64], keys: Sequence[Hashable]) -> _Clusters:
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    sums = np.bincount([numbers[key] for key in keys], residuals)
    count = len(sums)
    return _Clusters(float((sums**2).sum()) / len(residuals) ** 2 * count / max(1, count - 1), count)
