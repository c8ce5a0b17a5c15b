"""What a frame will cost, in seconds of rendering and encoding, by what frames like it have cost."""

from __future__ import annotations

import math
from collections import defaultdict

from tigas_common.wire.render import AnswerFormat

NEWEST = 0.2
"""The weight of the newest measurement in the running mean."""


class FrameCosts:
    """Running means by scene, format and size. Sizes within a factor of two count as one.

    Cost is not proportional to pixels: projecting and sorting a scene takes as long for a small frame. So nothing is
    extrapolated but bounds: a larger frame costs no less, and at most as much more as it has more pixels.
    """

    def __init__(self) -> None:
        self._means: defaultdict[tuple[str, AnswerFormat], dict[int, float]] = defaultdict(dict)

    def measured(self, scene: str, format: AnswerFormat, pixels: int, seconds: float) -> None:
        """A frame has cost so much."""
        means, size = self._means[scene, format], pixels.bit_length()
        means[size] = (1 - NEWEST) * means.get(size, seconds) + NEWEST * seconds

    def at_least(self, scene: str, format: AnswerFormat, pixels: int) -> float:
        """The cost of a frame of this size, as far as it is known: 0 if nothing is."""
        means, size = self._means.get((scene, format), {}), pixels.bit_length()
        if size in means:
            return means[size]
        smaller = [seconds for other, seconds in means.items() if other < size]
        larger = [seconds * 2.0 ** (size - other) for other, seconds in means.items() if other > size]
        return max(smaller + larger, default=0.0)

    def at_most(self, scene: str, format: AnswerFormat, pixels: int) -> float:
        """The cost of a frame of this size, or more: infinite if nothing is known."""
        means, size = self._means.get((scene, format), {}), pixels.bit_length()
        if size in means:
            return means[size]
        smaller = [seconds * 2.0 ** (size - other) for other, seconds in means.items() if other < size]
        larger = [seconds for other, seconds in means.items() if other > size]
        return min(smaller + larger, default=math.inf)

    def doubt(self, scene: str, format: AnswerFormat) -> None:
        """What is known was too much for a frame that was refused: let it fade, or it would never be measured again."""
        means = self._means.get((scene, format), {})
        for size in means:
            means[size] *= 0.9
