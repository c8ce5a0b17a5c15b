"""Packs a scene for the CPU, in chunks of neighbouring Gaussians that are culled together."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_render.gaussians import Batches
from tigas_render.raster.base import ALPHA_MIN, BASIS_CONSTANTS, PreparedScene
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.kernel import kernel
from tigas_render.raster.cpu.levels import FROM, Nodes, add_levels, bound_nodes, deviation_bound, full_detail, pad, room
from tigas_render.raster.cpu.order import sort_spatially

Floats = NDArray[np.float32]
HALF_MAX = 65504.0
"""The largest float16."""


@dataclass(frozen=True, slots=True)
class CpuScene(PreparedScene):
    """A packed scene; `layout` names the fields."""

    geometry: Floats
    """[chunks, GEOMETRY, CHUNK]"""
    sh: NDArray[np.float16]
    """[chunks · CHUNK / LANES, K · 3, LANES] coefficients, times the constants of their basis functions.

    Half precision suffices, because an error of 1/2048 of a coefficient is far below one step of an 8-bit colour.
    """
    bounds: NDArray[np.float64]
    """[chunks, BOUNDS]"""
    nodes: Nodes
    """The chunks of each node at each level of detail."""
    antialiased: bool
    """Whether the scene was trained with Mip-Splatting's 2D filter."""

    @property
    def nbytes(self) -> int:
        return self.geometry.nbytes + self.sh.nbytes + self.bounds.nbytes + self.nodes.nbytes


def pack(scene: Batches) -> CpuScene:
    """Pack a scene, without Gaussians that are too transparent to be drawn or have no finite position.

    Uses the memory of a batch and 8 bytes per Gaussian beyond the packed scene. Runs on one core, and leaves the others
    to the frames of other scenes.
    """
    first = next(scene.parts)
    most, coefficients = room(scene.most) * L.CHUNK, first.sh.shape[1]
    # one row per Gaussian, until they are sorted; the system allocates no memory for unwritten pages
    rows = np.empty((most, L.GEOMETRY), np.float32)
    sh = np.empty((most, coefficients * 3), np.float16)
    constants = np.array(BASIS_CONSTANTS[:coefficients], np.float32)[:, None]
    count = 0
    for part in itertools.chain((first,), scene.parts):
        means, scales, quaternions, opacities, colours = (
            np.ascontiguousarray(array, np.float32) for array in part.arrays
        )
        drawable = np.flatnonzero((opacities >= ALPHA_MIN) & np.isfinite(means).all(axis=1))
        end = count + len(drawable)
        describe(drawable, means, scales, quaternions, opacities, rows[count:end])
        halves = (colours[drawable] * constants).clip(-HALF_MAX, HALF_MAX).astype(np.float16)
        sh[count:end] = halves.reshape(len(drawable), coefficients * 3)
        count = end
    nodes, chunks = full_detail(count), -(-count // L.CHUNK)
    if count:
        scene.check()
        grid = sort_spatially(rows[:count], sh[:count])
        pad(rows, sh, count, chunks * L.CHUNK)
        if count >= FROM:
            chunks = add_levels(rows, sh, count, grid, first.antialiased, nodes, scene.check)
    rows, sh = rows[: chunks * L.CHUNK], sh[: chunks * L.CHUNK]
    bounds = np.zeros((chunks, L.BOUNDS))
    lay_out(rows, sh.view(np.uint16), bounds)
    bound_nodes(bounds, nodes.chunks, nodes.bounds)
    geometry = rows.reshape(chunks, L.GEOMETRY, L.CHUNK)
    return CpuScene(geometry, sh.reshape(-1, coefficients * 3, L.LANES), bounds, nodes, first.antialiased)


@kernel()
def describe(chosen, means, scales, quaternions, opacities, rows):
    """Fill rows [len(chosen), GEOMETRY] from the chosen Gaussians, with Σ = R S Sᵀ Rᵀ, as in 3DGS."""
    for number in range(chosen.shape[0]):
        i = chosen[number]
        into = rows[number]
        for axis in range(3):
            into[L.MEAN_X + axis] = means[i, axis]
        w, x, y, z = quaternions[i]
        sx, sy, sz = scales[i]
        m00, m01, m02 = (1 - 2 * (y * y + z * z)) * sx, 2 * (x * y - w * z) * sy, 2 * (x * z + w * y) * sz
        m10, m11, m12 = 2 * (x * y + w * z) * sx, (1 - 2 * (x * x + z * z)) * sy, 2 * (y * z - w * x) * sz
        m20, m21, m22 = 2 * (x * z - w * y) * sx, 2 * (y * z + w * x) * sy, (1 - 2 * (x * x + y * y)) * sz
        into[L.COV_XX] = m00 * m00 + m01 * m01 + m02 * m02
        into[L.COV_XY] = m00 * m10 + m01 * m11 + m02 * m12
        into[L.COV_XZ] = m00 * m20 + m01 * m21 + m02 * m22
        into[L.COV_YY] = m10 * m10 + m11 * m11 + m12 * m12
        into[L.COV_YZ] = m10 * m20 + m11 * m21 + m12 * m22
        into[L.COV_ZZ] = m20 * m20 + m21 * m21 + m22 * m22
        into[L.LOG_ALPHA] = np.log2(np.float64(opacities[i])) * L.ALPHA_SCALE


@kernel()
def lay_out(rows, sh, bounds):
    """Rearrange each chunk of rows [chunks · CHUNK, GEOMETRY] and sh [chunks · CHUNK, 3 · K] in place to the layout of
    CpuScene, and fill its bounds.
    """
    geometry = np.empty((L.GEOMETRY, L.CHUNK), np.float32)
    group = np.empty((sh.shape[1], L.LANES), np.uint16)
    for chunk in range(bounds.shape[0]):
        start, end = chunk * L.CHUNK, (chunk + 1) * L.CHUNK
        find_bounds(rows[start:end], bounds[chunk])
        for lane in range(L.CHUNK):
            for field in range(L.GEOMETRY):
                geometry[field, lane] = rows[start + lane, field]
        rows[start:end].reshape(-1)[:] = geometry.reshape(-1)
        for first in range(start, end, L.LANES):
            for lane in range(L.LANES):
                for number in range(sh.shape[1]):
                    group[number, lane] = sh[first + lane, number]
            sh[first : first + L.LANES].reshape(-1)[:] = group.reshape(-1)


@kernel()
def find_bounds(rows, bounds):
    """Fill bounds [BOUNDS] from rows [N, GEOMETRY]."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    largest = 0.0
    for i in range(rows.shape[0]):
        largest = max(largest, deviation_bound(rows[i]))
        for axis in range(3):
            low[axis] = min(low[axis], np.float64(rows[i, L.MEAN_X + axis]))
            high[axis] = max(high[axis], np.float64(rows[i, L.MEAN_X + axis]))
    bounds[L.BOUND_LOW : L.BOUND_LOW + 3] = low
    bounds[L.BOUND_HIGH : L.BOUND_HIGH + 3] = high
    bounds[L.BOUND_SCALE] = largest
