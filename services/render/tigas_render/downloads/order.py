"""In which order Gaussians are downloaded, so that the first of them are a picture of the whole scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.model import Point
from tigas_render.gaussians import Gaussians
from tigas_render.raster.morton import morton_codes

SHARES = (0.02, 0.05, 0.1, 0.25, 0.5)
"""Of a scene, after which a picture of what has come is worth its while."""
MULTIPLE = 256
"""Of which the Gaussians before such a moment are a multiple, as packed forms keep so many together."""
GROWTH = 3 / 8
"""1/2 would make up for all of the area that is still missing, and gaps are only part of what is wrong."""


@dataclass(frozen=True, slots=True)
class Part:
    """The first rows of a file, as a scene by itself."""

    count: int
    growth: float
    """How many times larger its Gaussians are best drawn, to close gaps."""

    @property
    def comment(self) -> str:
        """What a file's header says of it."""
        return f"first {self.count} growth {self.growth:.3f}"


@dataclass(frozen=True, slots=True)
class Order:
    """Indices of all Gaussians, and the parts that can be shown before all are there, the smallest first."""

    indices: NDArray[np.int64]
    parts: tuple[Part, ...]

    @classmethod
    def of(cls, gaussians: Gaussians, viewpoint: Point) -> Self:
        """Drawn at random, by the square root of each Gaussian's importance for somebody near `viewpoint`.

        Importance is opacity × area / squared distance: how much of the picture a Gaussian covers. In a sorted order,
        the small ones that some surfaces are made of would all be missing for long, and leave holes. Who draws n times
        gets n / importance of an exponential distribution as times of arrival, so that is what is sorted by
        (Efraimidis and Spirakis 2006, "Weighted random sampling with a reservoir"). The draw is always the same.
        """
        importance = _importance(gaussians, viewpoint)
        arrivals = np.random.default_rng(0).exponential(size=len(gaussians))
        indices = np.argsort(arrivals / np.sqrt(importance), kind="stable")
        covered = np.cumsum(importance[indices])
        counts = sorted({round(share * len(indices) / MULTIPLE) * MULTIPLE for share in SHARES} - {0})
        parts = (Part(count, float((covered[-1] / covered[count - 1]) ** GROWTH)) for count in counts)
        return cls(indices, tuple(part for part in parts if part.count < len(indices)))

    def with_neighbours_together(self, gaussians: Gaussians) -> Self:
        """The same parts; between their ends, neighbours in space are neighbours in the file."""
        codes = morton_codes(gaussians.means)
        ends = (0, *(part.count for part in self.parts), len(self.indices))
        runs = (self.indices[start:end] for start, end in pairwise(ends))
        return replace(self, indices=np.concatenate([run[np.argsort(codes[run], kind="stable")] for run in runs]))


def _importance(gaussians: Gaussians, viewpoint: Point) -> NDArray[np.float64]:
    """[N], above 0. Viewers walk, so nothing counts as nearer than half the median distance."""
    means = gaussians.means.astype(np.float64)
    scales = np.sort(gaussians.scales.astype(np.float64), axis=1)
    squared = ((means - viewpoint) ** 2).sum(1)
    tiny = np.finfo(np.float64).tiny
    near = max(float(np.median(squared)) / 4, tiny)
    covered = gaussians.opacities * scales[:, 2] * scales[:, 1] / np.maximum(squared, near)
    importance: NDArray[np.float64] = np.maximum(covered, tiny)
    return importance
