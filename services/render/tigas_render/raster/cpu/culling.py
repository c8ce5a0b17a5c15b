"""Decides whether a whole chunk is outside the picture, without looking at its Gaussians."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import math

from tigas_render.raster.base import ALPHA_MIN, NEAR_PLANE
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu import view as V
from tigas_render.raster.cpu.kernel import kernel

REACH = math.sqrt(2 * math.log(1 / ALPHA_MIN)) * 1.01
"""Standard deviations beyond which even an opaque Gaussian is not drawn, and a little for rounding."""


@kernel()
def chunk_is_outside(bounds, view):
    """Whether no Gaussian of a chunk can be drawn; False when in doubt.

    The centres lie inside the picture of the bounding box, as long as that is in front of the camera. The projected
    deviation is at most the norm of the projection's derivative times the greatest deviation.
    """
    nearest, farthest = math.inf, -math.inf
    left, right, top, bottom = math.inf, -math.inf, math.inf, -math.inf
    for corner in range(8):
        x = bounds[L.BOUND_HIGH if corner & 1 else L.BOUND_LOW] - view[V.EYE]
        y = bounds[(L.BOUND_HIGH if corner & 2 else L.BOUND_LOW) + 1] - view[V.EYE + 1]
        z = bounds[(L.BOUND_HIGH if corner & 4 else L.BOUND_LOW) + 2] - view[V.EYE + 2]
        depth = view[6] * x + view[7] * y + view[8] * z
        nearest, farthest = min(nearest, depth), max(farthest, depth)
        if depth > 0:
            u = (view[0] * x + view[1] * y + view[2] * z) / depth
            v = (view[3] * x + view[4] * y + view[5] * z) / depth
            left, right = min(left, u), max(right, u)
            top, bottom = min(top, v), max(bottom, v)
    if farthest < 0.999 * NEAR_PLANE:
        return True
    if not nearest > 0.999 * NEAR_PLANE:
        return False
    deviation = bounds[L.BOUND_SCALE] / nearest
    slope_x = max(abs(view[V.LEFT]), abs(view[V.RIGHT]))
    slope_y = max(abs(view[V.TOP]), abs(view[V.BOTTOM]))
    reach_x = REACH * math.sqrt((view[V.FX] * deviation) ** 2 * (1 + slope_x * slope_x) + view[V.FILTERED]) + 1
    reach_y = REACH * math.sqrt((view[V.FY] * deviation) ** 2 * (1 + slope_y * slope_y) + view[V.FILTERED]) + 1
    u0, u1 = view[V.FX] * left + view[V.CX] - reach_x, view[V.FX] * right + view[V.CX] + reach_x
    v0, v1 = view[V.FY] * top + view[V.CY] - reach_y, view[V.FY] * bottom + view[V.CY] + reach_y
    return u1 < 0 or u0 > view[V.WIDTH] or v1 < 0 or v0 > view[V.HEIGHT]
