"""A grid of the space that a scene occupies, and rays through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_render.scenes.start_view.surfels import Doubles, Surfels

Cells = NDArray[np.int64]
Flags = NDArray[np.bool_]

MAX_CELLS, MIN_CELLS = 88, 12
"""Maximum and minimum number of cells along the longest side."""
MAX_POINTS = 12
"""Maximum number of points into which a Gaussian larger than a cell is divided."""
DEPTH = 0.35
"""Optical depth above which a cell is occupied."""
FARTHEST = 10
"""Maximum distance, in cells, that is known to the nearest occupied cell."""
STEPS = 200
COLUMNS, ROWS = 36, 18
"""Resolution of the map of directions in which there are surroundings outside the grid."""


@dataclass(frozen=True, slots=True)
class Hits:
    """The ends of R rays."""

    distances: Doubles
    """[R] distance in scene units; infinite if the ray hits no cell of the grid."""
    cells: Cells
    """[R] flat index of the cell that was hit, or -1."""
    covered: Flags
    """[R] whether the ray hits a surface, in the grid or in its surroundings."""


class Grid:
    """Cells across the middle of a capture; everything outside it counts as distant surroundings."""

    def __init__(self, found: Surfels, share: float, *, whole: bool = False) -> None:
        """found: in a right, down, forward frame. share: of the Gaussians. whole: include the surroundings."""
        low, high = np.quantile(found.centres, (0.002, 0.998), axis=0) if whole else _central_bounds(found.centres)
        self.size = float(np.linalg.norm(high - low)) / 2
        """Half the diagonal of the middle of the capture, in scene units."""
        margin = max(0.04 * float((high - low).max()), 1e-6 * float(np.abs(found.centres).max()), 1e-9)
        across = int(np.clip(np.sqrt(len(found)) / 3, MIN_CELLS, MAX_CELLS))
        self.cell = float((high - low + 2 * margin).max()) / across
        """Side length of a cell, in scene units."""
        self.low = low - margin
        self.shape = tuple(int(n) for n in np.maximum(3, np.ceil((high - low + 2 * margin) / self.cell)))
        self._fill(found, share)
        self._clear = self._distances()

    def _fill(self, found: Surfels, share: float) -> None:
        """Distribute each Gaussian's area over the cells that it reaches, with points at fixed random places in it."""
        areas = found.opacities * np.pi * found.extents[:, 1] * found.extents[:, 2] / share
        pieces = np.ceil(found.extents[:, 1] * found.extents[:, 2] * 6 / self.cell**2).clip(1, MAX_POINTS)
        pieces = pieces.astype(np.int64)
        owner = np.repeat(np.arange(len(found)), pieces)
        offsets = np.random.default_rng(0).standard_normal((len(owner), 3)) * (pieces > 1)[owner, None]
        points = found.centres[owner] + np.einsum("nij,nj->ni", found.axes[owner], offsets * found.extents[owner])
        index, inside = self._cells(points)
        owner, index, total = owner[inside], index[inside], int(np.prod(self.shape))
        depth = np.bincount(index, (areas / pieces)[owner], total) / self.cell**2
        self.numbers = np.bincount(index, (1 / pieces)[owner], total)
        """[C] number of Gaussians in each cell."""
        sizes = np.log(np.sqrt(found.extents[:, 1] * found.extents[:, 2]).clip(1e-9 * self.cell))
        with np.errstate(invalid="ignore"):
            self.log_sizes = np.bincount(index, (sizes / pieces)[owner], total) / self.numbers
            self.lights = np.bincount(index, (found.lights / pieces)[owner], total) / self.numbers
        """[C] mean logarithm of their sizes, and mean brightness; NaN in empty cells."""
        there = depth > 0
        threshold = min(DEPTH, float(np.quantile(depth[there], 0.75))) if there.any() else DEPTH
        occupied = (depth >= threshold) & there
        self.occupied: Flags = occupied & (_count_neighbours(occupied.reshape(self.shape)).ravel() >= 3)
        if not self.occupied.any():
            self.occupied = occupied
        outside = ~self._cells(found.centres)[1]
        towards = found.centres[outside] - (self.low + np.array(self.shape) * self.cell / 2)
        self._around = np.zeros(COLUMNS * ROWS, np.bool_)
        self._around[_sky_cells(towards)] = True

    def _distances(self) -> NDArray[np.int64]:
        """[C] distance to the nearest occupied cell, in cells along the axis on which it is farthest."""
        near = self.occupied.reshape(self.shape)
        clear = np.where(near, 0, FARTHEST)
        for distance in range(1, FARTHEST):
            grown = _dilate(near)
            clear[grown & ~near] = distance
            near = grown
        return clear.ravel()

    def _cells(self, points: Doubles) -> tuple[Cells, Flags]:
        """[N] flat cell index of points [N, 3], and whether they are in the grid."""
        place = np.floor((points - self.low) / self.cell)
        inside = np.all((place >= 0) & (place < self.shape), axis=1)
        place = np.where(inside[:, None], place, 0).astype(np.int64)
        return (place[:, 0] * self.shape[1] + place[:, 1]) * self.shape[2] + place[:, 2], inside

    def clearance(self, points: Doubles) -> Doubles:
        """[N] distance to the nearest surface in scene units, to within a cell, up to FARTHEST cells; 0 outside."""
        cells, inside = self._cells(points)
        return np.where(inside, self._clear[cells], 0) * self.cell

    def lattice(self, columns: int, rows: int) -> Doubles:
        """[N, 3] points spaced evenly over the grid: `columns` along its longest horizontal side, `rows` in height."""
        extent = np.array(self.shape) * self.cell
        level = max(extent[0], extent[2]) / columns
        numbers = (max(3, round(extent[0] / level)), rows, max(3, round(extent[2] / level)))
        axes = [self.low[i] + (np.arange(n) + 0.5) / n * extent[i] for i, n in enumerate(numbers)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)

    def trace(self, origins: Doubles, directions: Doubles) -> Hits:
        """Follow R rays from origins [R, 3] along unit directions [R, 3] to the first occupied cell.

        Each step is as long as the space around is known to be empty (sphere tracing, Hart 1996).
        """
        number, shape = len(origins), np.array(self.shape)
        start = (origins - self.low) / self.cell  # in cells
        with np.errstate(divide="ignore", invalid="ignore"):
            bounds = np.stack((-start / directions, (shape - start) / directions))
        enter = np.nan_to_num(np.fmin(*bounds), nan=-np.inf).max(1)
        leave = np.nan_to_num(np.fmax(*bounds), nan=np.inf).min(1)
        travelled = np.maximum(enter + 1e-6, 0)
        cells, distances = np.full(number, -1), np.full(number, np.inf)
        active = np.flatnonzero(travelled < leave)
        for _ in range(STEPS):
            if not len(active):
                break
            place = (start[active] + directions[active] * travelled[active, None]).astype(np.int64)
            place = place.clip(0, shape - 1)
            index = (place[:, 0] * shape[1] + place[:, 1]) * shape[2] + place[:, 2]
            clear = self._clear[index]
            hit = clear == 0
            cells[active[hit]] = index[hit]
            distances[active[hit]] = travelled[active[hit]] * self.cell
            travelled[active] += np.maximum(clear - 1, 0.6)
            active = active[~hit & (travelled[active] < leave[active])]
        return Hits(distances, cells, (cells >= 0) | self._around[_sky_cells(directions)])


def _central_bounds(centres: Doubles) -> tuple[Doubles, Doubles]:
    """Lower and upper bounds [3] of the middle of a capture, without its background."""
    lowest, highest = np.quantile(centres, (0.015, 0.985), axis=0)
    inner = np.quantile(centres, (0.1, 0.9), axis=0)
    inner[:, 1] = np.quantile(centres[:, 1], (0.03, 0.97))
    centre, half = inner.mean(0), (inner[1] - inner[0]) / 2 * np.array([1.4, 1.2, 1.4])
    return np.maximum(lowest, centre - half), np.minimum(highest, centre + half)


def _sky_cells(directions: Doubles) -> Cells:
    """[N] index of directions [N, 3] in a map of all directions."""
    lengths = np.linalg.norm(directions, axis=1).clip(1e-12)
    column = ((np.arctan2(directions[:, 0], directions[:, 2]) / (2 * np.pi) + 0.5) * COLUMNS).astype(np.int64)
    row = ((np.arcsin((directions[:, 1] / lengths).clip(-1, 1)) / np.pi + 0.5) * ROWS).astype(np.int64)
    sky: Cells = row.clip(0, ROWS - 1) * COLUMNS + column % COLUMNS
    return sky


def _dilate(cells: Flags) -> Flags:
    """Grow a set of cells by all cells that touch it."""
    for axis in range(3):
        grown = cells.copy()
        a, b = (np.moveaxis(array, axis, 0) for array in (grown, cells))
        a[1:] |= b[:-1]
        a[:-1] |= b[1:]
        cells = grown
    return cells


def _count_neighbours(cells: Flags) -> NDArray[np.int64]:
    """Number of occupied cells among each cell and the 26 around it."""
    sums = cells.astype(np.int64)
    for axis in range(3):
        added = sums.copy()
        a, b = (np.moveaxis(array, axis, 0) for array in (added, sums))
        a[1:] += b[:-1]
        a[:-1] += b[1:]
        sums = added
    return sums
