"""Statistics of a scene, collected while its Gaussians pass on their way to the rasteriser."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.source import SceneMetadata
from tigas_render.scenes.start_view.view import StartView, view_of

SAMPLE = 100_000
"""Gaussians that are kept, about: 6 MB."""


class SceneStatistics:
    """Number, bounds and a sample of a scene's Gaussians."""

    def __init__(self, sample: int = SAMPLE) -> None:
        """sample: about how many are kept for the start view."""
        self._most = sample
        self.count = 0
        """Number of Gaussians that can be drawn."""
        self.low: NDArray[np.float32] = np.full(3, np.inf, np.float32)
        self.high: NDArray[np.float32] = np.full(3, -np.inf, np.float32)
        """Bounds of their centres, [3]."""
        self._some: list[Gaussians] = []

    @classmethod
    def of(cls, gaussians: Gaussians) -> SceneStatistics:
        """Statistics of all Gaussians of a scene: those that `collect` has in the end."""
        statistics = cls()
        for _ in statistics.collect(gaussians.batches()).parts:
            pass
        return statistics

    def collect(self, scene: Batches) -> Batches:
        """The same batches; reading them collects the statistics, which are complete in the end."""
        return Batches(scene.most, self._collected(scene))

    def _collected(self, scene: Batches) -> Iterator[Gaussians]:
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
        """Some Gaussians, spread evenly over the file, of SH degree 0."""
        columns = zip(*(some.arrays for some in self._some), strict=True)
        return Gaussians(*(np.concatenate(parts) for parts in columns))

    def view(self, metadata: SceneMetadata) -> StartView:
        """The start view in the scene's metadata, or else the derived one."""
        sample = self.sample
        return view_of(metadata, sample, len(sample) / self.count)
