"""Packs a scene for the CPU: neighbours in space become neighbours in memory, in chunks that are culled as one."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numba import prange
from numpy.typing import NDArray

from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import ALPHA_MIN, BASIS_CONSTANTS, PreparedScene
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.kernel import kernel
from tigas_render.raster.morton import morton_codes

Floats = NDArray[np.float32]
HALF_MAX = 65504.0
"""The greatest float16."""


@dataclass(frozen=True, slots=True)
class CpuScene(PreparedScene):
    """A packed scene; `layout` names the fields."""

    geometry: Floats
    """[chunks, GEOMETRY, CHUNK]"""
    sh: NDArray[np.float16]
    """[chunks · CHUNK / LANES, K · 3, LANES] coefficients, times the constants of their basis functions.

    Half precision is ample: an error of 1/2048 of a coefficient is far below one step of an 8-bit colour.
    """
    bounds: NDArray[np.float64]
    """[chunks, BOUNDS]"""
    antialiased: bool
    """As Gaussians have it."""

    @property
    def nbytes(self) -> int:
        """Bytes of the packed arrays."""
        return self.geometry.nbytes + self.sh.nbytes + self.bounds.nbytes


def pack(gaussians: Gaussians) -> CpuScene:
    """Pack a scene. Gaussians that are too transparent to be drawn, or nowhere, are left out."""
    means, scales, quaternions, opacities, sh = (
        np.ascontiguousarray(tensor.detach().cpu().numpy(), np.float32)
        for tensor in (gaussians.means, gaussians.scales, gaussians.quaternions, gaussians.opacities, gaussians.sh)
    )
    drawable = np.flatnonzero((opacities >= ALPHA_MIN) & np.isfinite(means).all(axis=1))
    codes = morton_codes(torch.from_numpy(means[drawable])).numpy()
    order = drawable[np.argsort(codes, kind="stable")]
    chunks = -(-len(order) // L.CHUNK)
    geometry = np.zeros((chunks, L.GEOMETRY, L.CHUNK), np.float32)
    packed_sh = np.zeros((chunks * L.CHUNK // L.LANES, sh.shape[1] * 3, L.LANES), np.float16)
    bounds = np.zeros((chunks, L.BOUNDS))
    constants = np.array(BASIS_CONSTANTS[: sh.shape[1]], np.float32)
    halves = (sh * constants[:, None]).clip(-HALF_MAX, HALF_MAX).astype(np.float16)
    flat_sh = halves.view(np.uint16).reshape(len(sh), sh.shape[1] * 3)
    _pack(order, means, scales, quaternions, opacities, flat_sh, geometry, packed_sh.view(np.uint16), bounds)
    return CpuScene(geometry, packed_sh, bounds, gaussians.antialiased)


@kernel(parallel=True)
def _pack(order, means, scales, quaternions, opacities, sh, geometry, packed_sh, bounds):
    """Fill geometry, packed_sh and bounds from the Gaussians order[...]: Σ = R S Sᵀ Rᵀ, as in 3DGS."""
    for chunk in prange(geometry.shape[0]):
        into = geometry[chunk]
        into[L.LOG_ALPHA, :] = np.float32(-2)
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        largest = 0.0
        for lane in range(min(L.CHUNK, order.shape[0] - chunk * L.CHUNK)):
            i = order[chunk * L.CHUNK + lane]
            for axis in range(3):
                into[L.MEAN_X + axis, lane] = means[i, axis]
                low[axis] = min(low[axis], np.float64(means[i, axis]))
                high[axis] = max(high[axis], np.float64(means[i, axis]))
                largest = max(largest, np.float64(scales[i, axis]))
            w, x, y, z = quaternions[i]
            sx, sy, sz = scales[i]
            m00, m01, m02 = (1 - 2 * (y * y + z * z)) * sx, 2 * (x * y - w * z) * sy, 2 * (x * z + w * y) * sz
            m10, m11, m12 = 2 * (x * y + w * z) * sx, (1 - 2 * (x * x + z * z)) * sy, 2 * (y * z - w * x) * sz
            m20, m21, m22 = 2 * (x * z - w * y) * sx, 2 * (y * z + w * x) * sy, (1 - 2 * (x * x + y * y)) * sz
            into[L.COV_XX, lane] = m00 * m00 + m01 * m01 + m02 * m02
            into[L.COV_XY, lane] = m00 * m10 + m01 * m11 + m02 * m12
            into[L.COV_XZ, lane] = m00 * m20 + m01 * m21 + m02 * m22
            into[L.COV_YY, lane] = m10 * m10 + m11 * m11 + m12 * m12
            into[L.COV_YZ, lane] = m10 * m20 + m11 * m21 + m12 * m22
            into[L.COV_ZZ, lane] = m20 * m20 + m21 * m21 + m22 * m22
            into[L.LOG_ALPHA, lane] = np.log2(np.float64(opacities[i])) * L.ALPHA_SCALE
            group = (chunk * L.CHUNK + lane) // L.LANES
            for coefficient in range(sh.shape[1]):
                packed_sh[group, coefficient, lane % L.LANES] = sh[i, coefficient]
        for axis in range(3):
            bounds[chunk, L.BOUND_LOW + axis] = low[axis]
            bounds[chunk, L.BOUND_HIGH + axis] = high[axis]
        bounds[chunk, L.BOUND_SCALE] = largest
