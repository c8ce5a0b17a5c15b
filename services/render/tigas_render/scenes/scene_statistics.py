"""Statistics of a scene, collected while its Gaussians pass on their way to the rasteriser."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.model import Point
from tigas_common.wire.render import StartCamera
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.start_camera import SAMPLE, derive_camera


class SceneStatistics:
    """Statistics of one scene, complete once all its Gaussians have been read."""

    def __init__(self) -> None:
        self.count = 0
        """Number of Gaussians that can be drawn."""
        self.low: NDArray[np.float32] = np.full(3, np.inf, np.float32)
        self.high: NDArray[np.float32] = np.full(3, -np.inf, np.float32)
        """Bounds of their centres, [3]."""
        self._some: list[Gaussians] = []

    def collect(self, scene: Batches) -> Batches:
        """The same batches; reading them collects the statistics."""
        return Batches(scene.most, self._collected(scene))

    def _collected(self, scene: Batches) -> Iterator[Gaussians]:
        step = max(1, scene.most // SAMPLE)
        for part in scene.parts:
            self.low = np.minimum(self.low, part.means.min(0))
            self.high = np.maximum(self.high, part.means.max(0))
            self._some.append(Gaussians(*(array[-self.count % step :: step].copy() for array in part.arrays)))
            self.count += len(part)
            yield part

    @property
    def sample(self) -> Gaussians:
        """About SAMPLE Gaussians, spread evenly over the file."""
        columns = zip(*(some.arrays for some in self._some), strict=True)
        return Gaussians(*(np.concatenate(parts) for parts in columns))

    def camera(self, up: Point) -> StartCamera:
        """A start camera, as by `derive_camera`."""
        sample = self.sample
        return derive_camera(sample.means, sample.opacities, sample.scales, up)
