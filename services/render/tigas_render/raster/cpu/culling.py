"""Culling: nodes and chunks that may be in the picture, and their level of detail."""

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
def choose_chunks(chunks, edges, bounds, view, edge_pixels, chosen):
    """Write the visible chunks of each node into `chosen`; returns their number.

    chunks, edges, bounds: see `levels.Nodes`. A node is drawn at its coarsest level whose cells, seen from its nearest
    corner, have edges of at most edge_pixels; 0 for the full detail.
    """
    count, focal = 0, max(view[V.FX], view[V.FY])
    for node in range(bounds.shape[0]):
        if is_outside(bounds[node], view):
            continue
        reach = edge_pixels * nearest_depth(bounds[node], view) / focal
        level = 0
        for coarser in range(1, edges.shape[1]):
            if edges[node, coarser] <= reach:
                level = coarser
        for chunk in range(chunks[node, level, 0], chunks[node, level, 1]):
            chosen[count] = chunk
            count += 1
    return count


@kernel()
def nearest_depth(bounds, view):
    """The depth of a bounding box's nearest corner."""
    depth = 0.0
    for axis in range(3):
        slope = view[6 + axis]
        corner = bounds[(L.BOUND_LOW if slope > 0 else L.BOUND_HIGH) + axis]
        depth += slope * (corner - view[V.EYE + axis])
    return depth


@kernel()
def is_outside(bounds, view):
    """Whether no Gaussian within some bounds can be drawn; False when in doubt.

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
