"""Colours from spherical harmonics, LANES Gaussians at a time (basis and signs of Kerbl et al., 3DGS, 2023)."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import numpy as np

from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.kernel import kernel

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
BRIGHTEST = F(1e9)
"""Bounds colours, so that no sum of them overflows."""


@kernel(inline=True)
def shade(geometry, start, eye, sh, group, coefficients, lane0, out):
    """Write the colours of LANES Gaussians of a chunk, 0 at least, into lanes from lane0 of `out` [USED · CHUNK].

    geometry, sh: flat; `start` and `group` are where the chunk's geometry and the lanes' coefficients begin.
    eye: the camera's centre [3]. The sums stay in registers: branches on the degree are hoisted out of the loop.
    """
    for j in range(U(L.LANES)):
        at = group + j
        i = lane0 + j
        red, green, blue = F(0.5) + sh[at], F(0.5) + sh[at + U(L.LANES)], F(0.5) + sh[at + U(2 * L.LANES)]
        if coefficients > 1:
            x = geometry[start + i] - eye[0]
            y = geometry[start + U(L.CHUNK) + i] - eye[1]
            z = geometry[start + U(2 * L.CHUNK) + i] - eye[2]
            inverse = F(1) / np.sqrt(x * x + y * y + z * z)
            x, y, z = x * inverse, y * inverse, z * inverse
            red, green, blue = add(red, green, blue, sh, at, 1, y)
            red, green, blue = add(red, green, blue, sh, at, 2, z)
            red, green, blue = add(red, green, blue, sh, at, 3, x)
            if coefficients > 4:
                xx, yy, zz = x * x, y * y, z * z
                red, green, blue = add(red, green, blue, sh, at, 4, x * y)
                red, green, blue = add(red, green, blue, sh, at, 5, y * z)
                red, green, blue = add(red, green, blue, sh, at, 6, F(2) * zz - xx - yy)
                red, green, blue = add(red, green, blue, sh, at, 7, x * z)
                red, green, blue = add(red, green, blue, sh, at, 8, xx - yy)
                if coefficients > 9:
                    red, green, blue = add(red, green, blue, sh, at, 9, y * (F(3) * xx - yy))
                    red, green, blue = add(red, green, blue, sh, at, 10, x * y * z)
                    red, green, blue = add(red, green, blue, sh, at, 11, y * (F(4) * zz - xx - yy))
                    red, green, blue = add(red, green, blue, sh, at, 12, z * (F(2) * zz - F(3) * xx - F(3) * yy))
                    red, green, blue = add(red, green, blue, sh, at, 13, x * (F(4) * zz - xx - yy))
                    red, green, blue = add(red, green, blue, sh, at, 14, z * (xx - yy))
                    red, green, blue = add(red, green, blue, sh, at, 15, x * (xx - F(3) * yy))
        out[U(L.RED * L.CHUNK) + i] = min(max(red, F(0)), BRIGHTEST)
        out[U(L.GREEN * L.CHUNK) + i] = min(max(green, F(0)), BRIGHTEST)
        out[U(L.BLUE * L.CHUNK) + i] = min(max(blue, F(0)), BRIGHTEST)


@kernel(inline=True)
def add(red, green, blue, sh, at, number, basis):
    """A colour plus one basis function times its coefficients."""
    at += U(3 * L.LANES * number)
    red += basis * sh[at]
    green += basis * sh[at + U(L.LANES)]
    blue += basis * sh[at + U(2 * L.LANES)]
    return red, green, blue
