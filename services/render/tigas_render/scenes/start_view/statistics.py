"""Statistics of a scene, collected while its Gaussians are read for the rasteriser."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.source import SceneMetadata
from tigas_render.scenes.start_view.view import StartView, resolve_view

SAMPLE = 100_000
"""Approximate number of Gaussians in the sample, which take 6 MB."""


class SceneStatistics:
    """Number, bounds and a sample of a scene's Gaussians."""

    def __init__(self, sample: int = SAMPLE) -> None:
        """sample: approximate number of Gaussians kept for the start view."""
        self._most = sample
        self.count = 0
        """Number of Gaussians that can be drawn."""
        self.low: NDArray[np.float32] = np.full(3, np.inf, np.float32)
        self.high: NDArray[np.float32] = np.full(3, -np.inf, np.float32)
        """Bounds of their centres, [3]."""
        self._some: list[Gaussians] = []

    @classmethod
    def of(cls, gaussians: Gaussians) -> SceneStatistics:
        """The statistics of a complete scene."""
        statistics = cls()
        for _ in statistics.collect(gaussians.batches()).parts:
            pass
        return statistics

    def collect(self, scene: Batches) -> Batches:
        """Wrap batches so that reading them collects the statistics, which are complete after the last batch."""
        return Batches(scene.most, self._collect(scene))

    def _collect(self, scene: Batches) -> Iterator[Gaussians]:
        step = -(-scene.most // self._most)
        for part in scene.parts:
            self.low = np.minimum(self.low, part.means.min(0))
            self.high = np.maximum(self.high, part.means.max(0))
            arrays = (*part.arrays[:4], part.sh[:, :1])
            self._some.append(Gaussians(*(array[-self.count % step :: step].copy() for array in arrays)))
            self.count += len(part)
            yield part

    @property
    def sample(self) -> Gaussians:
        """A sample of Gaussians, spaced evenly over the file, with SH degree 0."""
        columns = zip(*(some.arrays for some in self._some), strict=True)
        return Gaussians(*(np.concatenate(parts) for parts in columns))

    def view(self, metadata: SceneMetadata) -> StartView:
        """The start view in the scene's metadata, or else the derived one."""
        sample = self.sample
        return resolve_view(metadata, sample, len(sample) / self.count)
