"""The arrays that a scene's file is decoded into, in blocks, until they are Gaussians."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tigas_common.errors import BrokenScene
from tigas_render.gaussians import Gaussians

BLOCK = 4096
"""Gaussians that are converted at a time, so that nothing but the arrays grows with the scene."""
FARTHEST = 1e9
"""Scene units: no camera goes farther, and squares of larger standard deviations overflow."""
C0 = 0.28209479177387814
"""The spherical harmonic of degree 0: 1 / (2 √π)."""

_log = logging.getLogger(__name__)

Floats = NDArray[np.floating[Any]]


class Columns:
    """Room for a scene's Gaussians, as float32 in NumPy: PyTorch splits even small operations over threads that then
    wait for each other on a busy machine.

    Whoever decodes a file writes every row of every array, in whatever order the file has them.
    """

    def __init__(self, count: int, sh_degree: int) -> None:
        self.means = np.empty((count, 3), np.float32)
        self.scales = np.empty((count, 3), np.float32)
        """Standard deviations."""
        self.quaternions = np.empty((count, 4), np.float32)
        """w, x, y, z."""
        self.opacities = np.empty(count, np.float32)
        """0 to 1; NaN drops a Gaussian."""
        self.sh = np.empty((count, (sh_degree + 1) ** 2, 3), np.float32)

    def __len__(self) -> int:
        return len(self.means)

    def blocks(self) -> Iterator[slice]:
        """The rows, BLOCK at a time."""
        for start in range(0, len(self), BLOCK):
            yield slice(start, min(start + BLOCK, len(self)))

    def gaussians(self, path: Path, *, antialiased: bool = False) -> Gaussians:
        """What can be drawn of it: Gaussians that are not finite, lie or reach beyond FARTHEST, or have no rotation are
        dropped with a warning, in place. Raises BrokenScene if nothing is left.
        """
        arrays = (self.means, self.scales, self.quaternions, self.opacities, self.sh)
        kept = 0
        for block in self.blocks():
            usable = self._usable(block)
            end = kept + int(usable.sum())
            if end < block.stop:
                for array in arrays:
                    array[kept:end] = array[block][usable]
            kept = end
        if kept == 0:
            raise BrokenScene(f"{path.name} has no Gaussian whose attributes are finite and within 10⁹.")
        if kept < len(self):
            dropped = len(self) - kept
            _log.warning("%s: dropped %d of %d Gaussians that are not finite, or beyond 10⁹", path, dropped, len(self))
        return Gaussians(*(torch.from_numpy(array[:kept]) for array in arrays), antialiased=antialiased)

    def _usable(self, block: slice) -> NDArray[np.bool_]:
        usable = np.isfinite(self.quaternions[block]).all(1) & np.isfinite(self.opacities[block])
        usable &= np.isfinite(self.sh[block]).all((1, 2))
        with np.errstate(invalid="ignore"):
            usable &= (np.abs(self.means[block]) <= FARTHEST).all(1)
            usable &= ((self.scales[block] >= 0) & (self.scales[block] <= FARTHEST)).all(1)
        return usable


def normalised(quaternions: Floats) -> Floats:
    """Quaternions [N, 4] with length one; NaN where there is no direction."""
    wide = quaternions.astype(np.float64)  # as the square of a float32 may overflow
    with np.errstate(all="ignore"):
        wide /= np.linalg.norm(wide, axis=1, keepdims=True)
    return wide


def with_largest(others: Floats, largest: NDArray[np.integer[Any]]) -> Floats:
    """Unit quaternions [N, 4] of which three parts [N, 3] are known, and that the one at `largest` [N] is positive."""
    quaternions = np.empty((len(others), 4), np.float64)
    quaternions[np.arange(4) != largest[:, None]] = others.reshape(-1)
    missing = np.sqrt(np.maximum(0, 1 - (others.astype(np.float64) ** 2).sum(1)))
    quaternions[np.arange(len(others)), largest] = missing
    return normalised(quaternions)
