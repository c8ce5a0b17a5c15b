"""A scene's Gaussians, in the form that all loaders produce and all rasterisers consume."""

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
    """N Gaussians with activations applied, in contiguous arrays in the host's memory."""

    means: Floats
    """[N, 3] centres, in scene units."""
    scales: Floats
    """[N, 3] standard deviations along the Gaussian's own axes, in scene units."""
    quaternions: Floats
    """[N, 4] unit quaternions w, x, y, z: the rotation from the Gaussian's own axes to the scene's."""
    opacities: Floats
    """[N] in [0, 1]."""
    sh: Floats
    """[N, K, 3] spherical-harmonic coefficients of the colour, K = (degree + 1)²."""
    antialiased: bool = field(default=False, kw_only=True)
    """Whether they were trained with Mip-Splatting's 2D filter, and so must be drawn with it."""

    def __len__(self) -> int:
        return len(self.means)

    @property
    def sh_degree(self) -> int:
        """The degree of the spherical harmonics, 0 to 3."""
        return math.isqrt(self.sh.shape[1]) - 1

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Means, scales, quaternions, opacities and SH coefficients."""
        return self.means, self.scales, self.quaternions, self.opacities, self.sh

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self.arrays)

    def batches(self) -> Batches:
        """All Gaussians as one batch."""
        return Batches(len(self), iter((self,)))


@dataclass(frozen=True, slots=True)
class Batches:
    """A scene being read, one block of Gaussians at a time, so that they need not all fit in memory."""

    most: int
    """Maximum number of Gaussians: some may turn out not to be drawable."""
    parts: Iterator[Gaussians]
    """At least one block, all of the same SH degree. Raises the errors of reading them."""
    check: Callable[[], None] = lambda: None
    """Called regularly by long computations on the Gaussians, and may raise an error to abort them."""

    def read_all(self) -> Gaussians:
        """Read and return all Gaussians."""
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
