"""The first stage, which chooses the chunks that may be visible at a level of detail, projects their Gaussians, writes
compact records of the visible ones, and counts their tiles.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import math

import numpy as np
from numba import prange

from tigas_render.raster.base import ALPHA_MIN, NEAR_PLANE
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.binning import count_tiles
from tigas_render.raster.cpu.kernel import bits_of, fetch_add, float_of, kernel
from tigas_render.raster.cpu.sh import shade

U, F = np.uint64, np.float32
REACH = math.sqrt(2 * math.log(1 / ALPHA_MIN)) * 1.01
"""Standard deviations beyond which even an opaque Gaussian is not drawn, with a margin for rounding."""
LOG_E = F(math.log2(math.e) * L.ALPHA_SCALE)
"""Factor from a natural to a scaled binary logarithm."""
TWO_LN_2 = F(2 * math.log(2) / L.ALPHA_SCALE)
FARTHEST = F(1e7)
"""Distance in pixels beyond which centres are not drawn, because float32 cannot resolve fractions of a pixel there."""

# log2(1 + x) for -1/3 ≤ x < 1/3 is x p(x); p is a minimax polynomial, to an error of 2e-5.
L0, L1, L2, L3, L4 = F(1.4427446), F(-0.71988666), F(0.47765657), F(-0.40174732), F(0.33878011)
TWO_THIRDS = np.uint32(0x3F2AAAAB)
"""2/3, as the bits of a float32."""


@kernel()
def choose_chunks(chunks, edges, bounds, view, edge_pixels, chosen):
    """Write the visible chunks of each node into `chosen`. Returns their number.

    chunks, edges, bounds: see `levels.Nodes`. edge_pixels: each node is drawn at the coarsest level with cell edges no
    longer than this on screen, at the node's nearest corner; 0 for the full detail.
    """
    count, focal = 0, max(view[L.FX], view[L.FY])
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
        depth += slope * (corner - view[L.EYE + axis])
    return depth


@kernel()
def is_outside(bounds, view):
    """Whether no Gaussian within these bounds can be visible; False if in doubt.

    The centres are inside the projected bounding box if that is in front of the camera. A projected deviation is at
    most the norm of the projection's derivative times the largest deviation.
    """
    nearest, farthest = math.inf, -math.inf
    left, right, top, bottom = math.inf, -math.inf, math.inf, -math.inf
    for corner in range(8):
        x = bounds[L.BOUND_HIGH if corner & 1 else L.BOUND_LOW] - view[L.EYE]
        y = bounds[(L.BOUND_HIGH if corner & 2 else L.BOUND_LOW) + 1] - view[L.EYE + 1]
        z = bounds[(L.BOUND_HIGH if corner & 4 else L.BOUND_LOW) + 2] - view[L.EYE + 2]
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
    slope_x = max(abs(view[L.LEFT]), abs(view[L.RIGHT]))
    slope_y = max(abs(view[L.TOP]), abs(view[L.BOTTOM]))
    reach_x = REACH * math.sqrt((view[L.FX] * deviation) ** 2 * (1 + slope_x * slope_x) + view[L.FILTERED]) + 1
    reach_y = REACH * math.sqrt((view[L.FY] * deviation) ** 2 * (1 + slope_y * slope_y) + view[L.FILTERED]) + 1
    u0, u1 = view[L.FX] * left + view[L.CX] - reach_x, view[L.FX] * right + view[L.CX] + reach_x
    v0, v1 = view[L.FY] * top + view[L.CY] - reach_y, view[L.FY] * bottom + view[L.CY] + reach_y
    return u1 < 0 or u0 > view[L.WIDTH] or v1 < 0 or v0 > view[L.HEIGHT]


@kernel(parallel=True)
def project(geometry, sh, bounds, chosen, view, splats, keys, visible, slices, tile_counts, tiles_x, scratch, turn):
    """Project the chosen chunks, shade their visible Gaussians, and count tiles.

    geometry, sh: the packed scene, flat. bounds [chunks, BOUNDS]. chosen [C]: chunks. view [VIEW].
    splats: flat [C · CHUNK · RECORD], with each chosen chunk's visible Gaussians at the chunk's place.
    keys [C · CHUNK + AHEAD]: for each splat, the bits of its depth << 32 | the box of its tiles.
    visible [C]: number of splats in each chosen chunk. slices [S + 1]: runs of chosen chunks, handed out to threads.
    tile_counts [S, tiles]: number of a slice's splats that touch each tile.
    scratch [threads, USED · CHUNK]. turn [1]: the next slice, initially 0.
    """
    coefficients = sh.shape[0] // max(1, bounds.shape[0] * L.CHUNK * 3)
    for thread in prange(scratch.shape[0]):
        while True:
            part = fetch_add(turn, 0)
            if part >= slices.shape[0] - 1:
                break
            tile_counts[part, :] = 0
            for place in range(slices[part], slices[part + 1]):
                chunk = chosen[place]
                visible[place] = 0
                if not is_outside(bounds[chunk], view):
                    start = U(chunk * L.GEOMETRY * L.CHUNK)
                    project_chunk(geometry, start, view, scratch[thread])
                    visible[place] = keep_visible(
                        geometry, start, sh, U(chunk * coefficients * 3 * L.CHUNK), coefficients, view,
                        scratch[thread], splats, keys, place * L.CHUNK * L.RECORD, tile_counts[part], tiles_x,
                    )  # fmt: skip


@kernel()
def project_chunk(geometry, start, view, out):
    """EWA projection of one chunk into `out` [USED · CHUNK], one row per field. COLUMNS is 0 for invisible Gaussians.

    One input, one output, unsigned indices and no branches, so that it vectorises.
    """
    r00, r01, r02 = F(view[0]), F(view[1]), F(view[2])
    r10, r11, r12 = F(view[3]), F(view[4]), F(view[5])
    r20, r21, r22 = F(view[6]), F(view[7]), F(view[8])
    ex, ey, ez = F(view[L.EYE]), F(view[L.EYE + 1]), F(view[L.EYE + 2])
    fx, fy, cx, cy = F(view[L.FX]), F(view[L.FY]), F(view[L.CX]), F(view[L.CY])
    x_low, x_high, y_low, y_high = F(view[L.LEFT]), F(view[L.RIGHT]), F(view[L.TOP]), F(view[L.BOTTOM])
    width, height = F(view[L.WIDTH]), F(view[L.HEIGHT])
    dilation, filtered = F(view[L.DILATION]), F(view[L.FILTERED])
    for i in range(U(L.CHUNK)):
        at = start + i
        x = geometry[at + U(L.MEAN_X * L.CHUNK)] - ex
        y = geometry[at + U(L.MEAN_Y * L.CHUNK)] - ey
        z = geometry[at + U(L.MEAN_Z * L.CHUNK)] - ez
        px, py, pz = r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z, r20 * x + r21 * y + r22 * z
        inverse = F(1) / pz
        tx, ty = px * inverse, py * inverse
        u, v = fx * tx + cx, fy * ty + cy
        tx, ty = min(max(tx, x_low), x_high), min(max(ty, y_low), y_high)
        # rows of J W, the derivative of the projection in world axes
        jx, jy = fx * inverse, fy * inverse
        ax, ay, az = jx * (r00 - tx * r20), jx * (r01 - tx * r21), jx * (r02 - tx * r22)
        bx, by, bz = jy * (r10 - ty * r20), jy * (r11 - ty * r21), jy * (r12 - ty * r22)
        sxx, sxy = geometry[at + U(L.COV_XX * L.CHUNK)], geometry[at + U(L.COV_XY * L.CHUNK)]
        sxz, syy = geometry[at + U(L.COV_XZ * L.CHUNK)], geometry[at + U(L.COV_YY * L.CHUNK)]
        syz, szz = geometry[at + U(L.COV_YZ * L.CHUNK)], geometry[at + U(L.COV_ZZ * L.CHUNK)]
        ux, uy, uz = sxx * ax + sxy * ay + sxz * az, sxy * ax + syy * ay + syz * az, sxz * ax + syz * ay + szz * az
        vx, vy, vz = sxx * bx + sxy * by + sxz * bz, sxy * bx + syy * by + syz * bz, sxz * bx + syz * by + szz * bz
        cxx = ax * ux + ay * uy + az * uz
        cxy = ax * vx + ay * vy + az * vz
        cyy = bx * vx + by * vy + bz * vz
        # opacity lost to the filter: det(Σ + c I) = det Σ + c tr Σ + c², safe where det Σ is nearly 0
        area, trace = max(cxx * cyy - cxy * cxy, F(0)), cxx + cyy
        lost = (area + dilation * (trace + dilation)) / (area + filtered * (trace + filtered))
        cxx += filtered
        cyy += filtered
        determinant = cxx * cyy - cxy * cxy
        scale = LOG_E / determinant
        log_alpha = geometry[at + U(L.LOG_ALPHA * L.CHUNK)] + F(0.5 * L.ALPHA_SCALE) * log2(lost)
        reach = (log_alpha - F(L.LOG_ALPHA_MIN)) * TWO_LN_2  # squared, in standard deviations
        rx, ry = np.sqrt(reach * cxx), np.sqrt(reach * cyy)
        # False for NaN and for values that would overflow later
        ok = (
            (pz >= F(NEAR_PLANE))
            & (pz < F(1e30))
            & (log_alpha >= F(L.LOG_ALPHA_MIN))
            & (determinant > F(0))
            & (scale * (cxx + cyy) < F(1e6))
            & (abs(u) < FARTHEST)
            & (abs(v) < FARTHEST)
            & (rx < F(1e30))
            & (ry < F(1e30))
        )
        # pixels with centres within reach
        x0 = np.int32((min(max(u - rx, F(0)), width) if ok else F(0)) + F(0.5))
        x1 = np.int32((min(max(u + rx, F(0)), width) if ok else F(0)) + F(0.5))
        y0 = np.int32((min(max(v - ry, F(0)), height) if ok else F(0)) + F(0.5))
        y1 = np.int32((min(max(v + ry, F(0)), height) if ok else F(0)) + F(0.5))
        inside = ok & (x0 < x1) & (y0 < y1)
        columns = x0 | (x1 << np.int32(16))
        rows = y0 | (y1 << np.int32(16))
        out[U(L.CENTRE_X * L.CHUNK) + i] = u
        out[U(L.CENTRE_Y * L.CHUNK) + i] = v
        out[U(L.XX * L.CHUNK) + i] = F(-0.5) * scale * cyy
        out[U(L.XY * L.CHUNK) + i] = scale * cxy
        out[U(L.YY * L.CHUNK) + i] = F(-0.5) * scale * cxx
        out[U(L.LOG * L.CHUNK) + i] = log_alpha
        out[U(L.COLUMNS * L.CHUNK) + i] = float_of(np.uint32(columns if inside else np.int32(0)))
        out[U(L.ROWS * L.CHUNK) + i] = float_of(np.uint32(rows))
        out[U(L.DEPTH * L.CHUNK) + i] = pz


@kernel(inline=True)
def log2(x):
    """The binary logarithm of a positive float32, exactly 0 for 1. It vectorises, unlike NumPy's."""
    exponent = np.int32(bits_of(x) - TWO_THIRDS) >> np.int32(23)
    fraction = float_of(np.uint32(bits_of(x) - np.uint32(exponent << np.int32(23)))) - F(1)
    return F(exponent) + fraction * (L0 + fraction * (L1 + fraction * (L2 + fraction * (L3 + fraction * L4))))


@kernel()
def keep_visible(geometry, start, sh, sh_start, coefficients, view, projected, splats, keys, into, counts, tiles_x):
    """Shade a projected chunk's visible Gaussians, and write their records from splats[into]. Returns their number."""
    eye = (F(view[L.EYE]), F(view[L.EYE + 1]), F(view[L.EYE + 2]))
    at = into
    for lane0 in range(0, L.CHUNK, L.LANES):
        seen = np.uint32(0)
        for lane in range(U(L.LANES)):
            seen |= bits_of(projected[U(L.COLUMNS * L.CHUNK + lane0) + lane])
        if seen == 0:
            continue
        group = sh_start + U(lane0 * coefficients * 3)
        shade(geometry, start, eye, sh, group, coefficients, U(lane0), projected)
        for lane in range(lane0, lane0 + L.LANES):
            if bits_of(projected[U(L.COLUMNS * L.CHUNK + lane)]) != 0:
                for field in range(L.USED):
                    splats[U(at + field)] = projected[U(field * L.CHUNK + lane)]
                tiles = count_tiles(splats, at, counts, tiles_x)
                depth = bits_of(projected[U(L.DEPTH * L.CHUNK + lane)])
                keys[U(at // L.RECORD)] = (U(depth) << U(32)) | tiles
                at += L.RECORD
    return (at - into) // L.RECORD
