"""Colours from spherical harmonics, LANES Gaussians at a time (basis and signs of Kerbl et al., 3DGS, 2023)."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator,call-arg,var-annotated"
from __future__ import annotations

import numpy as np
from numba import njit

from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.intrinsics import OPTIONS

BASIS_CONSTANTS = np.array(
    [
        0.28209479177387814,
        -0.4886025119029199,
        0.4886025119029199,
        -0.4886025119029199,
        1.0925484305920792,
        -1.0925484305920792,
        0.31539156525252005,
        -1.0925484305920792,
        0.5462742152960396,
        -0.5900435899266435,
        2.890611442640554,
        -0.4570457994644658,
        0.3731763325901154,
        -0.4570457994644658,
        1.445305721320277,
        -0.5900435899266435,
    ],
    np.float32,
)
"""The constant factor of each basis function, signs included; packed coefficients are already multiplied by it."""

U, F = np.uint64, np.float32
R0, G0, B0 = U(L.RED * L.CHUNK), U(L.GREEN * L.CHUNK), U(L.BLUE * L.CHUNK)


@njit(inline="always", **OPTIONS)
def add_basis(out, sh, first, lane, k, basis):
    """Add one basis function, times its coefficients, to one lane's colour."""
    at = first + U(3 * L.CHUNK * k) + lane
    out[R0 + lane] += basis * sh[at]
    out[G0 + lane] += basis * sh[at + U(L.CHUNK)]
    out[B0 + lane] += basis * sh[at + U(2 * L.CHUNK)]


@njit(**OPTIONS)
def shade(geometry, start, eye, sh, sh_start, coefficients, lane0, out):
    """Write the colours of lanes lane0 … lane0 + LANES - 1 of a chunk, 0 at least, into `out` [USED · CHUNK].

    geometry and sh are flat; `start` and `sh_start` are where the chunk begins. eye: camera centre [3].
    """
    ex, ey, ez = eye[0], eye[1], eye[2]
    for j in range(U(L.LANES)):
        i = lane0 + j
        out[R0 + i] = F(0.5) + sh[sh_start + i]
        out[G0 + i] = F(0.5) + sh[sh_start + U(L.CHUNK) + i]
        out[B0 + i] = F(0.5) + sh[sh_start + U(2 * L.CHUNK) + i]
    if coefficients > 1:
        for j in range(U(L.LANES)):
            i = lane0 + j
            x = geometry[start + i] - ex
            y = geometry[start + U(L.CHUNK) + i] - ey
            z = geometry[start + U(2 * L.CHUNK) + i] - ez
            inverse = F(1) / np.sqrt(x * x + y * y + z * z)
            x, y, z = x * inverse, y * inverse, z * inverse
            add_basis(out, sh, sh_start, i, 1, y)
            add_basis(out, sh, sh_start, i, 2, z)
            add_basis(out, sh, sh_start, i, 3, x)
            if coefficients > 4:
                xx, yy, zz = x * x, y * y, z * z
                add_basis(out, sh, sh_start, i, 4, x * y)
                add_basis(out, sh, sh_start, i, 5, y * z)
                add_basis(out, sh, sh_start, i, 6, F(2) * zz - xx - yy)
                add_basis(out, sh, sh_start, i, 7, x * z)
                add_basis(out, sh, sh_start, i, 8, xx - yy)
                if coefficients > 9:
                    add_basis(out, sh, sh_start, i, 9, y * (F(3) * xx - yy))
                    add_basis(out, sh, sh_start, i, 10, x * y * z)
                    add_basis(out, sh, sh_start, i, 11, y * (F(4) * zz - xx - yy))
                    add_basis(out, sh, sh_start, i, 12, z * (F(2) * zz - F(3) * xx - F(3) * yy))
                    add_basis(out, sh, sh_start, i, 13, x * (F(4) * zz - xx - yy))
                    add_basis(out, sh, sh_start, i, 14, z * (xx - yy))
                    add_basis(out, sh, sh_start, i, 15, x * (xx - F(3) * yy))
    for j in range(U(L.LANES)):
        i = lane0 + j
        out[R0 + i] = max(out[R0 + i], F(0))
        out[G0 + i] = max(out[G0 + i], F(0))
        out[B0 + i] = max(out[B0 + i], F(0))
