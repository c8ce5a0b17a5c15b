"""Coarser levels of a large scene: in each node, the Gaussians in the same small cell of space are merged into one.

A node is a group of neighbouring chunks. Its first level has all of its Gaussians, and each further level at most a
quarter of the previous one. Cells are those of the Z-order's grid, as small as that limit allows. Only Gaussians
smaller than a cell are merged, so a level differs from the full detail by at most a cell's edge. A node is drawn at the
coarsest level for which this edge is short on screen (`project.choose_chunks`).
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_render.raster.base import ALPHA_MAX, DILATION
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.kernel import kernel, widen
from tigas_render.raster.cpu.order import Grid, morton_code

U = np.uint64
FROM = 1 << 20
"""Minimum number of Gaussians for a scene to have levels; two cores can draw smaller scenes in full."""
LEVELS = 3
COARSER = 2
"""A level has at most 1 / 2^COARSER of the previous level's Gaussians."""
NODE = 16
"""Number of chunks in a node at full detail."""
COARSE_CHUNKS = sum(NODE >> (COARSER * level) for level in range(1, LEVELS))
"""Maximum number of chunks in all other levels of a node."""
EDGE_PIXELS, MOST_EDGE_PIXELS = 0.7, 4.0
"""Length of a cell's edge on screen: the usual maximum, and the maximum if too much would be drawn otherwise."""
MOST_CHUNKS = 2 * FROM // L.CHUNK
"""Number of chunks above which detail is reduced: two million Gaussians take two cores a tenth of a second."""
NEVER = math.inf
"""The edge of a level that a node lacks."""


@dataclass(frozen=True, slots=True)
class Nodes:
    """The chunks of N nodes at each level."""

    chunks: NDArray[np.int64]
    """[N, LEVELS, 2] first and last + 1 of the chunks."""
    edges: NDArray[np.float64]
    """[N, LEVELS] length of a cell's edge, in scene units; 0 for the full detail."""
    bounds: NDArray[np.float64]
    """[N, BOUNDS] bounds of all chunks of a node."""

    @property
    def nbytes(self) -> int:
        return self.chunks.nbytes + self.edges.nbytes + self.bounds.nbytes


def room(count: int) -> int:
    """Maximum number of chunks in a scene of `count` Gaussians, including all levels."""
    chunks = -(-count // L.CHUNK)
    return chunks + (-(-chunks // NODE) * COARSE_CHUNKS if count >= FROM else 0)


def full_detail(count: int) -> Nodes:
    """The nodes of `count` Gaussians, in order, with a single level. Bounds are filled in later."""
    chunks = -(-count // L.CHUNK)
    nodes = -(-chunks // NODE)
    levels = np.zeros((nodes, LEVELS, 2), np.int64)
    levels[:, 0, 0] = np.arange(nodes) * NODE
    levels[:, 0, 1] = np.minimum(levels[:, 0, 0] + NODE, chunks)
    edges = np.full((nodes, LEVELS), NEVER)
    edges[:, 0] = 0
    return Nodes(levels, edges, np.zeros((nodes, L.BOUNDS)))


def add_levels(
    rows: NDArray[np.float32],
    sh: NDArray[np.float16],
    count: int,
    grid: Grid,
    antialiased: bool,
    nodes: Nodes,
    check: Callable[[], None],
) -> int:
    """Write the coarser levels after the full detail, and into `nodes`. Returns the number of chunks in use.

    rows [room · CHUNK, GEOMETRY], sh [room · CHUNK, 3 · K]: the first `count` are Gaussians in the grid's Z-order.
    check: called at each node, and may raise an error to abort.
    """
    codes, sizes = np.empty(NODE * L.CHUNK, np.uint64), np.empty(NODE * L.CHUNK)
    colours = np.empty((NODE * L.CHUNK >> COARSER, sh.shape[1]), np.float32)
    end_of_all = -(-count // L.CHUNK)
    for node in range(len(nodes.edges)):
        check()
        begin, end = node * NODE * L.CHUNK, min((node + 1) * NODE * L.CHUNK, count)
        for level in range(1, LEVELS):
            most = NODE * L.CHUNK >> (COARSER * level)
            if end - begin <= most:
                break
            finer, finer_sh = rows[begin:end], sh[begin:end].view(np.uint16)
            measure(finer, *grid, codes, sizes)
            doublings = cells_for(most, codes[: len(finer)], sizes, grid.cell, grid.axis_bits)
            if doublings < 0:
                break
            edge = grid.cell * 2.0**doublings
            # The variance of a pixel at the distance at which the level is first used. In a scene that was trained
            # antialiased the filter reduces opacity, so that it does not change the coverage.
            blur = 0.0 if antialiased else DILATION * (edge / EDGE_PIXELS) ** 2
            first, begin = end_of_all, end_of_all * L.CHUNK
            number = merge(finer, finer_sh, codes, sizes, 3 * doublings, edge, blur, rows[begin:], colours)
            sh[begin : begin + number] = colours[:number]
            end, end_of_all = begin + number, first - (-number // L.CHUNK)
            pad(rows, sh, end, end_of_all * L.CHUNK)
            nodes.chunks[node, level] = first, end_of_all
            nodes.edges[node, level] = edge
    return end_of_all


def pad(rows: NDArray[np.float32], sh: NDArray[np.float16], start: int, end: int) -> None:
    """Fill the rest of a chunk, start … end - 1, with invisible copies of its last Gaussian."""
    if start < end:
        rows[start:end], sh[start:end] = rows[start - 1], 0
        rows[start:end, L.LOG_ALPHA] = -2


@kernel()
def bound_nodes(chunk_bounds, chunks, bounds):
    """Fill the nodes' bounds [N, BOUNDS] from the bounds of their chunks [N, LEVELS, 2]."""
    for node in range(bounds.shape[0]):
        into = bounds[node]
        into[:] = chunk_bounds[chunks[node, 0, 0]]
        for level in range(chunks.shape[1]):
            for chunk in range(chunks[node, level, 0], chunks[node, level, 1]):
                for axis in range(3):
                    low, high = L.BOUND_LOW + axis, L.BOUND_HIGH + axis
                    into[low] = min(into[low], chunk_bounds[chunk, low])
                    into[high] = max(into[high], chunk_bounds[chunk, high])
                into[L.BOUND_SCALE] = max(into[L.BOUND_SCALE], chunk_bounds[chunk, L.BOUND_SCALE])


@kernel()
def measure(rows, low, scale, axis_bits, codes, sizes):
    """Write the Z-order code of each row, and a bound on its deviation, infinite outside the grid."""
    for i in range(rows.shape[0]):
        codes[i] = morton_code(rows[i], low, scale, axis_bits)
        sizes[i] = deviation_bound(rows[i])
        for axis in range(3):
            place = (np.float64(rows[i, L.MEAN_X + axis]) - low[axis]) * scale + 0.25
            if not 0.0 <= place <= 1.0:
                sizes[i] = math.inf


@kernel()
def cells_for(most, codes, sizes, cell, axis_bits):
    """Number of times to double the cells' edges until `merge` leaves at most `most` Gaussians; -1 if it never does.

    cell: the edge of the grid's own cells.
    """
    for doublings in range(axis_bits + 1):
        edge, shift = cell * 2.0**doublings, U(3 * doublings)
        count, is_first = 0, True
        for i in range(codes.shape[0]):
            if i > 0 and codes[i] >> shift != codes[i - 1] >> shift:
                is_first = True
            if not sizes[i] <= edge:
                count += 1
            elif is_first:
                count += 1
                is_first = False
        if count <= most:
            return doublings
    return -1


@kernel()
def merge(rows, sh, codes, sizes, shift, edge, blur, into, colours):
    """Write a coarser level of rows [N, GEOMETRY] and sh [N, 3 · K] into `into` and `colours`. Returns its size.

    The Gaussians in a cell that are no larger than it are merged into one with the same first and second moments, each
    weighted by its coverage: opacity times area, averaged over directions. The merged opacity gives their joint
    transmittance at independent positions. blur: added to the variances for both, in scene units².
    """
    at, begin = 0, 0
    mean, covariance, colour = np.empty(3), np.empty(6), np.empty(sh.shape[1])
    while begin < rows.shape[0]:
        end = begin + 1
        while end < rows.shape[0] and codes[end] >> U(shift) == codes[begin] >> U(shift):
            end += 1
        total, merged = 0.0, 0
        mean[:], covariance[:], colour[:] = 0, 0, 0
        for i in range(begin, end):
            if sizes[i] <= edge:
                weight = opacity(rows[i]) * area(rows[i, L.COV_XX : L.COV_ZZ + 1], blur)
                total += weight
                merged += 1
                last = i
                for axis in range(3):
                    mean[axis] += weight * rows[i, L.MEAN_X + axis]
                for number in range(colour.shape[0]):
                    colour[number] += weight * widen(sh[i, number])
            else:
                into[at] = rows[i]
                for number in range(colour.shape[0]):
                    colours[at, number] = widen(sh[i, number])
                at += 1
        if merged == 1 or (merged > 1 and not total > 0):
            into[at] = rows[last]
            for number in range(colour.shape[0]):
                colours[at, number] = widen(sh[last, number])
            at += 1
        elif merged > 1:
            mean /= total
            for i in range(begin, end):
                if sizes[i] <= edge:
                    weight = opacity(rows[i]) * area(rows[i, L.COV_XX : L.COV_ZZ + 1], blur) / total
                    add_moments(rows[i], mean, weight, covariance)
            passed, whole = 1.0, area(covariance, blur)
            for i in range(begin, end):
                if sizes[i] <= edge:
                    covered = opacity(rows[i]) * area(rows[i, L.COV_XX : L.COV_ZZ + 1], blur)
                    passed *= 1 - min(covered / whole, ALPHA_MAX)
            for axis in range(3):
                into[at, L.MEAN_X + axis] = mean[axis]
            for field in range(6):
                into[at, L.COV_XX + field] = covariance[field]
            into[at, L.LOG_ALPHA] = math.log2(1 - passed) * L.ALPHA_SCALE
            for number in range(colour.shape[0]):
                colours[at, number] = colour[number] / total
            at += 1
        begin = end
    return at


@kernel(inline=True)
def opacity(row):
    """The opacity of a Gaussian, 0 to 1."""
    return 2.0 ** (np.float64(row[L.LOG_ALPHA]) / L.ALPHA_SCALE)


@kernel()
def area(covariance, blur):
    """Mean area of an ellipsoid's projections, up to a factor: √(σ₁²σ₂² + σ₂²σ₃² + σ₃²σ₁²), the root of the second
    invariant of its covariance [6]: xx, xy, xz, yy, yz, zz.
    """
    xx, yy, zz = covariance[0] + blur, covariance[3] + blur, covariance[5] + blur
    xy, xz, yz = covariance[1], covariance[2], covariance[4]
    return math.sqrt(max(xx * yy - xy * xy + yy * zz - yz * yz + zz * xx - xz * xz, 0.0))


@kernel()
def add_moments(row, mean, weight, covariance):
    """Add a Gaussian's second moments about `mean`, multiplied by its weight, to covariance [6]."""
    x, y, z = row[L.MEAN_X] - mean[0], row[L.MEAN_Y] - mean[1], row[L.MEAN_Z] - mean[2]
    covariance[0] += weight * (row[L.COV_XX] + x * x)
    covariance[1] += weight * (row[L.COV_XY] + x * y)
    covariance[2] += weight * (row[L.COV_XZ] + x * z)
    covariance[3] += weight * (row[L.COV_YY] + y * y)
    covariance[4] += weight * (row[L.COV_YZ] + y * z)
    covariance[5] += weight * (row[L.COV_ZZ] + z * z)


@kernel()
def deviation_bound(row):
    """An upper bound on a Gaussian's largest deviation: the square root of its covariance's Frobenius norm."""
    squares = 0.0
    for field in range(L.COV_XX, L.LOG_ALPHA):
        off_diagonal = field == L.COV_XY or field == L.COV_XZ or field == L.COV_YZ
        squares += (2 if off_diagonal else 1) * np.float64(row[field]) ** 2
    return math.sqrt(math.sqrt(squares))
