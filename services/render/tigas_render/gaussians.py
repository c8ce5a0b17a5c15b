"""A scene's Gaussians, as every loader gives them and every rasteriser takes them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Gaussians:
    """N Gaussians with activations applied; contiguous, in the host's memory."""

    means: Floats
    """[N, 3] centres, in scene units."""
    scales: Floats
    """[N, 3] standard deviations along the Gaussian's own axes, in scene units."""
    quaternions: Floats
    """[N, 4] unit quaternions w, x, y, z: the Gaussian's own axes to the scene."""
    opacities: Floats
    """[N] in [0, 1]."""
    sh: Floats
    """[N, K, 3] spherical-harmonic coefficients of the colour, K = (degree + 1)²."""
    antialiased: bool = field(default=False, kw_only=True)
    """Whether they were trained with Mip-Splatting's 2D filter, and so have to be drawn with it."""

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """0 to 3."""
        return math.isqrt(self.sh.shape[1]) - 1

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Means, scales, quaternions, opacities and SH coefficients."""
        return self.means, self.scales, self.quaternions, self.opacities, self.sh

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self.arrays)

    def batches(self) -> Batches:
        """All of them as one batch."""
        return Batches(len(self), iter((self,)))


@dataclass(frozen=True, slots=True)
class Batches:
    """A scene being read, a block of Gaussians at a time, so that they need not all be in memory."""

    most: int
    """Gaussians that there are, or a few more: some may turn out not to be drawable."""
    parts: Iterator[Gaussians]
    """At least one, all of the same SH degree. Raises the errors of reading them."""
    check: Callable[[], None] = lambda: None
    """Called at intervals by long computations on the Gaussians; raises to end them."""

    def gathered(self) -> Gaussians:
        """All of them."""
        first = next(self.parts)
        if len(first) == self.most:
            return first
        whole = [np.empty((self.most, *array.shape[1:]), np.float32) for array in first.arrays]
        count = 0
        for part in itertools.chain((first,), self.parts):
            for array, rows in zip(whole, part.arrays, strict=True):
                array[count : count + len(rows)] = rows
            count += len(part)
        return Gaussians(*(array[:count] for array in whole), antialiased=first.antialiased)
