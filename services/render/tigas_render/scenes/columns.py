"""The arrays that a scene's file is decoded into, a block at a time, until they are Gaussians."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import BrokenScene
from tigas_render.gaussians import Gaussians

BLOCK = 4096
"""Gaussians that are read at a time, so that memory for them does not grow with the scene."""
FARTHEST = 1e9
"""Scene units: no camera goes farther, and squares of larger standard deviations overflow."""
C0 = 0.28209479177387814
"""The spherical harmonic of degree 0: 1 / (2 √π)."""

_log = logging.getLogger(__name__)

Floats = NDArray[np.floating[Any]]
Listener = Callable[[float], None]
"""Progress callback of a long task, from 0 to 1; an exception from it ends the task."""


class Columns:
    """Buffer for a block of Gaussians, as float32.

    Decoders write every row of every array.
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

    def only(self, rows: NDArray[np.bool_], sh_degree: int) -> Columns:
        """Selected rows, with the coefficients of an equal or higher degree; missing ones are 0."""
        some = Columns(int(np.count_nonzero(rows)), sh_degree)
        some.means[:], some.scales[:] = self.means[rows], self.scales[rows]
        some.quaternions[:], some.opacities[:] = self.quaternions[rows], self.opacities[rows]
        some.sh[:, : self.sh.shape[1]], some.sh[:, self.sh.shape[1] :] = self.sh[rows], 0
        return some

    def gaussians(self, *, antialiased: bool) -> Gaussians:
        """The drawable Gaussians: those that are not finite, extend beyond FARTHEST, or lack a rotation are dropped."""
        usable = self._usable()
        rows: NDArray[np.bool_] | slice = slice(None) if usable.all() else usable
        arrays = (self.means, self.scales, self.quaternions, self.opacities, self.sh)
        return Gaussians(*(array[rows] for array in arrays), antialiased=antialiased)

    def _usable(self) -> NDArray[np.bool_]:
        usable = np.isfinite(self.quaternions).all(1) & np.isfinite(self.opacities)
        usable &= np.isfinite(self.sh).all((1, 2))
        with np.errstate(invalid="ignore"):
            usable &= (np.abs(self.means) <= FARTHEST).all(1)
            usable &= ((self.scales >= 0) & (self.scales <= FARTHEST)).all(1)
        return usable


def blocks(count: int, listener: Listener) -> Iterator[slice]:
    """Rows in slices of BLOCK; the listener is called after each."""
    for start in range(0, count, BLOCK):
        stop = min(start + BLOCK, count)
        yield slice(start, stop)
        listener(stop / count)


def drawable(path: Path, decoded: Iterable[Columns], *, antialiased: bool) -> Iterator[Gaussians]:
    """The drawable Gaussians of a file's blocks (`Columns.gaussians`), with a warning about the others.

    Raises BrokenScene if there are none.
    """
    count = kept = 0
    for columns in decoded:
        gaussians = columns.gaussians(antialiased=antialiased)
        count, kept = count + len(columns), kept + len(gaussians)
        if len(gaussians):
            yield gaussians
    if kept == 0:
        raise BrokenScene(f"{path.name} has no Gaussian whose attributes are finite and within 10⁹.")
    if kept < count:
        _log.warning("%s: dropped %d of %d Gaussians that are not finite, or beyond 10⁹", path, count - kept, count)


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
