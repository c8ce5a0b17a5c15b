"""The order in which Gaussians are downloaded, so that the first ones already show the whole scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.model import Point
from tigas_render.gaussians import Gaussians
from tigas_render.raster.morton import morton_codes
from tigas_render.scenes.scene_file import enlargement

SHARES = (0.02, 0.05, 0.1, 0.25, 0.5)
"""Shares of a scene after which the received part is worth showing."""
MULTIPLE = 256
"""Parts have a multiple of this number of Gaussians, the chunk size of packed formats."""


@dataclass(frozen=True, slots=True)
class Part:
    """The first rows of a file, as an independent scene."""

    count: int
    growth: float
    """The best factor by which to enlarge its Gaussians, to close gaps."""

    @property
    def comment(self) -> str:
        """Metadata in the file's header."""
        return f"first {self.count} growth {self.growth:.3f}"


@dataclass(frozen=True, slots=True)
class Order:
    """Indices of all Gaussians, and the parts that can be shown before all have arrived, smallest first."""

    indices: NDArray[np.int64]
    parts: tuple[Part, ...]


def download_order(gaussians: Gaussians, viewpoint: Point, check: Callable[[], None] = lambda: None) -> Order:
    """A random permutation weighted by the square root of each Gaussian's importance to a viewer near `viewpoint`.

    Importance is opacity × area / squared distance: the covered area of the image. In a strictly sorted order, all
    small Gaussians of some surfaces would be missing for a long time, and leave holes. Weighted sampling assigns each
    Gaussian an exponential arrival time divided by its weight, and sorts by it (Efraimidis and Spirakis 2006, "Weighted
    random sampling with a reservoir"). The seed is fixed. Within a part, Gaussians are in Z-order.

    check: called between the steps, of which sorting takes longest, and may raise an error to abort.
    """
    importance = _importance(gaussians, viewpoint)
    check()
    arrivals = np.random.default_rng(0).exponential(size=len(gaussians))
    indices = np.argsort(arrivals / np.sqrt(importance), kind="stable")
    check()
    covered = np.cumsum(importance[indices])
    counts = sorted({round(share * len(indices) / MULTIPLE) * MULTIPLE for share in SHARES} - {0})
    parts = [Part(count, float(enlargement(covered[-1] / covered[count - 1]))) for count in counts]
    parts = [part for part in parts if part.count < len(indices)]
    codes = morton_codes(gaussians.means)
    runs = np.split(indices, [part.count for part in parts])
    return Order(np.concatenate([_sort_by_place(run, codes, check) for run in runs]), tuple(parts))


def _sort_by_place(run: NDArray[np.int64], codes: NDArray[np.int64], check: Callable[[], None]) -> NDArray[np.int64]:
    check()
    return run[np.argsort(codes[run], kind="stable")]


def _importance(gaussians: Gaussians, viewpoint: Point) -> NDArray[np.float64]:
    """Importance [N], above 0. Distances are clamped to at least half the median, because viewers walk around."""
    means = gaussians.means.astype(np.float64)
    scales = np.sort(gaussians.scales.astype(np.float64), axis=1)
    squared = ((means - viewpoint) ** 2).sum(1)
    tiny = np.finfo(np.float64).tiny
    near = max(float(np.median(squared)) / 4, tiny)
    covered = gaussians.opacities * scales[:, 2] * scales[:, 1] / np.maximum(squared, near)
    importance: NDArray[np.float64] = np.maximum(covered, tiny)
    return importance
