"""A cost model: predicts the seconds of rendering and encoding a frame from similar frames."""

from __future__ import annotations

import math
from collections import defaultdict

from tigas_common.wire.render import AnswerFormat

NEWEST = 0.2
"""The weight of the newest measurement in the running mean."""


class CostModel:
    """Running means by scene, format and size class, each class spanning a factor of two.

    Cost is not proportional to pixels, because projecting and sorting take as long for a small frame. For other sizes
    the model therefore gives bounds only: a larger frame costs at least as much, and at most in proportion to its
    pixels.
    """

    def __init__(self) -> None:
        self._means: defaultdict[tuple[str, AnswerFormat], dict[int, float]] = defaultdict(dict)

    def measured(self, scene: str, format: AnswerFormat, pixels: int, seconds: float) -> None:
        """Record the cost of a finished frame."""
        means, size = self._means[scene, format], pixels.bit_length()
        means[size] = (1 - NEWEST) * means.get(size, seconds) + NEWEST * seconds

    def at_least(self, scene: str, format: AnswerFormat, pixels: int) -> float:
        """A lower bound on the cost of a frame of this size: 0 without measurements."""
        means, size = self._means.get((scene, format), {}), pixels.bit_length()
        if size in means:
            return means[size]
        smaller = [seconds for other, seconds in means.items() if other < size]
        larger = [seconds * 2.0 ** (size - other) for other, seconds in means.items() if other > size]
        return max(smaller + larger, default=0.0)

    def at_most(self, scene: str, format: AnswerFormat, pixels: int) -> float:
        """An upper bound on the cost of a frame of this size: infinite without measurements."""
        means, size = self._means.get((scene, format), {}), pixels.bit_length()
        if size in means:
            return means[size]
        smaller = [seconds * 2.0 ** (size - other) for other, seconds in means.items() if other < size]
        larger = [seconds for other, seconds in means.items() if other > size]
        return min(smaller + larger, default=math.inf)

    def doubt(self, scene: str, format: AnswerFormat) -> None:
        """Lower the estimates that led to refusing a frame; otherwise they would never be measured again."""
        means = self._means.get((scene, format), {})
        for size in means:
            means[size] *= 0.9
