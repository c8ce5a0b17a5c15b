"""Colours from spherical harmonics, LANES Gaussians at a time (basis and signs of Kerbl et al., 3DGS, 2023)."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import numpy as np

from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.kernel import kernel, prefetch, widen

U, F = np.uint64, np.float32
CACHE_LINE_HALVES = 32
GROUPS_AHEAD = 2
"""Number of groups of LANES Gaussians to prefetch ahead."""
BRIGHTEST = F(1e9)
"""Maximum colour value, so that no sum of colours overflows."""


@kernel()
def shade(geometry, start, eye, sh, group, coefficients, lane0, out):
    """Write the colours, at least 0, of LANES Gaussians of a chunk into `out` [USED · CHUNK] from lane0 on.

    geometry, sh: flat. start, group: offsets of the chunk's geometry and of the lanes' coefficients. eye: the camera's
    position [3]. Each degree has its own loop, because a branch inside it would be vectorised to masked loads, which
    cost twice as much. Coefficients are prefetched, because the processor's own prefetching falls short here.
    """
    floats = U(coefficients * 3 * L.LANES)
    for ahead in range(U(0), floats, U(CACHE_LINE_HALVES)):
        prefetch(sh, group + U(GROUPS_AHEAD) * floats + ahead)
    if coefficients == 1:
        for j in range(U(L.LANES)):
            store(out, lane0 + j, degree0(sh, group + j))
    elif coefficients == 4:
        for j in range(U(L.LANES)):
            x, y, z = direction(geometry, start + lane0 + j, eye)
            store(out, lane0 + j, degree1(sh, group + j, degree0(sh, group + j), x, y, z))
    elif coefficients == 9:
        for j in range(U(L.LANES)):
            x, y, z = direction(geometry, start + lane0 + j, eye)
            colour = degree1(sh, group + j, degree0(sh, group + j), x, y, z)
            store(out, lane0 + j, degree2(sh, group + j, colour, x, y, z))
    else:
        for j in range(U(L.LANES)):
            x, y, z = direction(geometry, start + lane0 + j, eye)
            colour = degree1(sh, group + j, degree0(sh, group + j), x, y, z)
            colour = degree2(sh, group + j, colour, x, y, z)
            store(out, lane0 + j, degree3(sh, group + j, colour, x, y, z))


@kernel(inline=True)
def direction(geometry, at, eye):
    """The unit vector from the camera to a Gaussian."""
    x, y, z = geometry[at] - eye[0], geometry[at + U(L.CHUNK)] - eye[1], geometry[at + U(2 * L.CHUNK)] - eye[2]
    inverse = F(1) / np.sqrt(x * x + y * y + z * z)
    return x * inverse, y * inverse, z * inverse


@kernel(inline=True)
def store(out, lane, colour):
    """Write a colour into a lane of `out`, clamped to 0 … BRIGHTEST."""
    out[U(L.RED * L.CHUNK) + lane] = min(max(colour[0], F(0)), BRIGHTEST)
    out[U(L.GREEN * L.CHUNK) + lane] = min(max(colour[1], F(0)), BRIGHTEST)
    out[U(L.BLUE * L.CHUNK) + lane] = min(max(colour[2], F(0)), BRIGHTEST)


@kernel(inline=True)
def add(sh, at, number, colour, basis):
    """A colour plus one basis function times its coefficients."""
    at += U(3 * L.LANES * number)
    return (
        colour[0] + basis * widen(sh[at]),
        colour[1] + basis * widen(sh[at + U(L.LANES)]),
        colour[2] + basis * widen(sh[at + U(2 * L.LANES)]),
    )


@kernel(inline=True)
def degree0(sh, at):
    """The view-independent colour."""
    return add(sh, at, 0, (F(0.5), F(0.5), F(0.5)), F(1))


@kernel(inline=True)
def degree1(sh, at, colour, x, y, z):
    """A colour plus the first degree, in the direction (x, y, z)."""
    colour = add(sh, at, 1, colour, y)
    colour = add(sh, at, 2, colour, z)
    return add(sh, at, 3, colour, x)


@kernel(inline=True)
def degree2(sh, at, colour, x, y, z):
    """A colour plus the second degree."""
    colour = add(sh, at, 4, colour, x * y)
    colour = add(sh, at, 5, colour, y * z)
    colour = add(sh, at, 6, colour, F(2) * z * z - x * x - y * y)
    colour = add(sh, at, 7, colour, x * z)
    return add(sh, at, 8, colour, x * x - y * y)


@kernel(inline=True)
def degree3(sh, at, colour, x, y, z):
    """A colour plus the third degree."""
    xx, yy, zz = x * x, y * y, z * z
    colour = add(sh, at, 9, colour, y * (F(3) * xx - yy))
    colour = add(sh, at, 10, colour, x * y * z)
    colour = add(sh, at, 11, colour, y * (F(4) * zz - xx - yy))
    colour = add(sh, at, 12, colour, z * (F(2) * zz - F(3) * xx - F(3) * yy))
    colour = add(sh, at, 13, colour, x * (F(4) * zz - xx - yy))
    colour = add(sh, at, 14, colour, z * (xx - yy))
    return add(sh, at, 15, colour, x * (xx - F(3) * yy))
