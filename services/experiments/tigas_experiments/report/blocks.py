"""Blocks, which figures are averaged and compared over, and the interval that a mean over blocks is known to lie in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

from tigas_common.wire.run import Configuration
from tigas_experiments.report.metrics import Metric

LEAST_BLOCKS = 6
"""For an interval: if nothing but chance decided each block's sign, fewer would agree in more than 5 % of all cases."""
RESAMPLES = 5000
SEED = 1


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a network trace × a part of a movement × a scene: what a controller's figures depend on beside itself.

    Repeats of one block are no blocks of their own: they tell how much a run varies, and nothing of other inputs.
    """

    network: str
    """Without its round trip."""
    trace_offset_s: float
    scene: str
    movement: str
    movement_offset_s: float

    @classmethod
    def of(cls, configuration: Configuration) -> Self:
        """Of a run."""
        network = configuration.network
        return cls(
            network.name,
            network.offset_s,
            configuration.scene,
            Path(configuration.movement).name,
            configuration.movement_offset_s,
        )


ByBlock = Mapping[Block, float]
"""A figure of each block, the mean over its repeats; inf is a time that never came."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean over blocks, and its 95 % bootstrap confidence interval."""

    mean: float
    interval: tuple[float, float] | None
    """From low to high; None with fewer than LEAST_BLOCKS."""
    blocks: int

    @classmethod
    def over(cls, values: Sequence[float]) -> Self | None:
        """Of one value a block; None if there is no block."""
        if not values:
            return None
        mean = sum(values) / len(values)  # nan if a block is inf and another -inf
        return cls(mean, _interval(tuple(values)) if len(values) >= LEAST_BLOCKS else None, len(values))

    @property
    def certain(self) -> bool:
        """Whether it differs from zero."""
        return self.interval is not None and (self.interval[0] > 0 or self.interval[1] < 0)

    def range(self, metric: Metric) -> str:
        """The interval as a person reads it."""
        if self.interval is None:
            return f"[no interval over {self.blocks} block{'s' * (self.blocks != 1)}]"
        low, high = (signed(metric, value) if math.isinf(value) else metric.text(value) for value in self.interval)
        return f"[{low}, {high}]"


def signed(metric: Metric, difference: float) -> str:
    """A difference as a person reads it; one that is infinite: only one side ever came."""
    if math.isnan(difference):
        return metric.text(None)
    if math.isinf(difference):
        return "−∞" if difference < 0 else "∞"
    return f"{'+' * (difference > 0)}{metric.text(difference)}"


def differences(one: ByBlock, other: ByBlock) -> dict[Block, float]:
    """One less the other in each block that both have; none where neither ever came."""
    return {block: 0.0 if one[block] == other[block] else one[block] - other[block] for block in one if block in other}


@lru_cache(100_000)
def _interval(values: tuple[float, ...]) -> tuple[float, float]:
    """By the percentile bootstrap, always with the same resamples.

    What is infinite counts as the outermost finite value for the end that it is not beyond, so that this end is never
    too far out, and makes the other end infinite.
    """
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return min(values), max(values)
    low, high = (float(end) for end in _bootstrap(np.clip(values, min(finite), max(finite))))
    return min(low, min(values)) if -math.inf in values else low, math.inf if math.inf in values else high


def _bootstrap(values: NDArray[np.float64]) -> tuple[float, float]:
    if np.ptp(values) == 0:
        return values[0], values[0]
    found = bootstrap(
        (values,), np.mean, n_resamples=RESAMPLES, method="percentile", rng=np.random.default_rng(SEED)
    ).confidence_interval
    return found.low, found.high
