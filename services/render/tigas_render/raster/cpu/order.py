"""Sorts a scene into Z-order, in place because a scene may fill most of the memory."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.kernel import kernel
from tigas_render.raster.morton import BITS, morton_grid

U = np.uint64


class Grid(NamedTuple):
    """The cells by which rows are sorted; see `morton.morton_grid`."""

    low: NDArray[np.float64]
    scale: float
    axis_bits: int
    """Binary logarithm of the number of cells per axis."""

    @property
    def cell(self) -> float:
        """The length of a cell's edge, in scene units."""
        return 1 / (self.scale * ((1 << self.axis_bits) - 1))


def sort_spatially(rows: NDArray[np.float32], sh: NDArray[np.float16]) -> Grid:
    """Sort rows [N, GEOMETRY] and sh [N, M], N > 0, so that neighbours in space are neighbours in memory.

    Uses 8 additional bytes per Gaussian.
    """
    index_bits = len(rows).bit_length()
    grid = Grid(*morton_grid(rows[:, L.MEAN_X : L.MEAN_X + 3]), min(BITS, (64 - index_bits) // 3))
    keys = np.empty(len(rows), np.uint64)
    fill_keys(rows, *grid, index_bits, keys)
    keys.sort()
    keys &= np.uint64((1 << index_bits) - 1)
    reorder(keys.view(np.int64), rows, sh.view(np.uint16))
    return grid


@kernel()
def fill_keys(rows, low, scale, axis_bits, index_bits, keys):
    """Write keys with each row's Z-order code in the upper bits and its index in the lower ones."""
    for i in range(rows.shape[0]):
        keys[i] = morton_code(rows[i], low, scale, axis_bits) << U(index_bits) | U(i)


@kernel()
def morton_code(row, low, scale, axis_bits):
    """The Z-order code of a Gaussian's cell (see `morton`)."""
    most, code = (1 << axis_bits) - 1, U(0)
    for axis in range(3):
        place = (np.float64(row[L.MEAN_X + axis]) - low[axis]) * scale + 0.25
        cell = U(min(max(place, 0.0), 1.0) * most)
        for bit in range(axis_bits):
            code |= (cell >> U(bit) & U(1)) << U(3 * bit + axis)
    return code


@kernel()
def reorder(order, rows, sh):
    """Move row order[i] of both arrays to place i, along the permutation's cycles. Overwrites `order`."""
    one_row, one_sh = np.empty(rows.shape[1], rows.dtype), np.empty(sh.shape[1], sh.dtype)
    for start in range(order.shape[0]):
        if order[start] == start:
            continue
        one_row[:], one_sh[:] = rows[start], sh[start]
        place = start
        while order[place] != start:
            source = order[place]
            rows[place], sh[place] = rows[source], sh[source]
            order[place] = place
            place = source
        rows[place], sh[place] = one_row, one_sh
        order[place] = place
