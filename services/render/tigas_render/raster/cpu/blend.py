"""The last stage, which blends each tile's Gaussians front to back and writes its pixels."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import numpy as np
from numba import prange

from tigas_render.raster.base import ALPHA_MAX, TRANSMITTANCE_MIN
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.binning import pixel_box
from tigas_render.raster.cpu.kernel import fetch_add, kernel, prefetch

U, F = np.uint64, np.float32
CELL = 2
"""Side length of a depth cell in pixels. Tiles consist of whole cells, so that every cell has one writer."""
CHECK_EVERY = 32
"""Number of Gaussians between two checks of whether a tile is finished."""
AHEAD = 16
"""Number of records to prefetch ahead."""
CHANNELS = 5
"""Red, green, blue, the transmittance, which is negative once the pixel is finished, and weight / z for depth. The
layout is the same without depth, because the additional memory costs nothing and one loop serves both.
"""
BLOCK_FLOATS = CHANNELS * L.LANES
TILE_FLOATS = BLOCK_FLOATS * L.TILE_BLOCKS * L.TILE_BLOCKS
LIGHT, INVERSE = U(3 * L.LANES), U(4 * L.LANES)

# exp2(8 x) for -1 ≤ x ≤ 0 is p(x)⁸; p is a minimax polynomial of 2^x there.
P0, P1, P2 = F(0.9999999250673), F(0.6931422526456), F(0.2401721894460)
P3, P4, P5 = F(0.05527972284758), F(0.009188611833452), F(0.0009387883195262)


@kernel(parallel=True)
def blend(splats, starts, begin, end, entries, background, frame, cells, accumulators, turn):
    """Draw tiles begin … end - 1 into frame [H, W, 3] uint8. background: RGB float32.

    cells: output of `write_cells`, or None. The two cases are compiled separately, so that depth costs nothing unless
    requested. accumulators [threads, TILE_FLOATS]. turn [1]: the next tile, initially `begin`.
    """
    tiles_x = (frame.shape[1] + L.TILE - 1) // L.TILE
    for thread in prange(accumulators.shape[0]):
        while True:
            tile = fetch_add(turn, 0)
            if tile >= end:
                break
            x0, y0 = tile % tiles_x * L.TILE, tile // tiles_x * L.TILE
            blend_tile(splats, entries, starts[tile], starts[tile + 1], x0, y0, accumulators[thread], cells)
            write_tile(accumulators[thread], background, x0, y0, frame)
            if cells is not None:
                write_cells(accumulators[thread], x0, y0, frame.shape[1], frame.shape[0], cells)


@kernel()
def blend_tile(splats, entries, start, end, tile_x, tile_y, acc, cells):
    """Blend entries[start:end] into `acc`: blocks of BLOCK × BLOCK pixels, row by row, each CHANNELS × LANES floats."""
    for j in range(U(TILE_FLOATS)):
        acc[j] = F(1) if j % U(BLOCK_FLOATS) // U(L.LANES) == U(3) else F(0)
    for i in range(start, end):
        if i + AHEAD < end:
            prefetch(splats, (entries[i + AHEAD] & U(0xFFFFFFFF)) * U(L.RECORD))
        at = (entries[i] & U(0xFFFFFFFF)) * U(L.RECORD)
        x0, x1, y0, y1 = pixel_box(splats, at)
        bx0, bx1 = max(x0 - tile_x, 0) // L.BLOCK, (min(x1 - tile_x, L.TILE) - 1) // L.BLOCK
        by0, by1 = max(y0 - tile_y, 0) // L.BLOCK, (min(y1 - tile_y, L.TILE) - 1) // L.BLOCK
        u, v = splats[at + U(L.CENTRE_X)] - F(tile_x) - F(0.5), splats[at + U(L.CENTRE_Y)] - F(tile_y) - F(0.5)
        xx, xy, yy = splats[at + U(L.XX)], splats[at + U(L.XY)], splats[at + U(L.YY)]
        log_alpha = splats[at + U(L.LOG)]
        red, green, blue = splats[at + U(L.RED)], splats[at + U(L.GREEN)], splats[at + U(L.BLUE)]
        inverse = F(1) / splats[at + U(L.DEPTH)]
        for by in range(by0, by1 + 1):
            top = F(by * L.BLOCK) - v
            for bx in range(bx0, bx1 + 1):
                left = F(bx * L.BLOCK) - u
                first = U((by * L.TILE_BLOCKS + bx) * BLOCK_FLOATS)
                for lane in range(U(L.LANES)):
                    dx, dy = left + F(np.int32(lane & U(3))), top + F(np.int32(lane >> U(2)))
                    x = log_alpha + yy * dy * dy + (xx * dx + xy * dy) * dx
                    p = P0 + x * (P1 + x * (P2 + x * (P3 + x * (P4 + x * P5))))
                    p *= p
                    p *= p
                    alpha = min(p * p, F(ALPHA_MAX))
                    alpha = alpha if x >= F(L.LOG_ALPHA_MIN) else F(0)
                    light = acc[first + LIGHT + lane]
                    before = max(light, F(0))
                    weight = alpha * before
                    after = before - weight
                    lit = after > F(TRANSMITTANCE_MIN)
                    weight = weight if lit else F(0)
                    acc[first + LIGHT + lane] = after if lit else -abs(light)
                    acc[first + lane] += weight * red
                    acc[first + U(L.LANES) + lane] += weight * green
                    acc[first + U(2 * L.LANES) + lane] += weight * blue
                    if cells is not None:
                        acc[first + INVERSE + lane] += weight * inverse
        if (i - start) % CHECK_EVERY == CHECK_EVERY - 1 and is_finished(acc):
            break


@kernel()
def is_finished(acc):
    """Whether all pixels of a tile are finished."""
    for block in range(L.TILE_BLOCKS * L.TILE_BLOCKS):
        first = U(block * BLOCK_FLOATS) + LIGHT
        lit = np.uint32(0)
        for lane in range(U(L.LANES)):
            lit |= np.uint32(1) if acc[first + lane] > F(0) else np.uint32(0)
        if lit:
            return False
    return True


@kernel()
def write_tile(acc, background, x0, y0, frame):
    """Blend a tile with the background and write it into the frame."""
    for y in range(min(L.TILE, frame.shape[0] - y0)):
        for x in range(min(L.TILE, frame.shape[1] - x0)):
            block = (y // L.BLOCK) * L.TILE_BLOCKS + x // L.BLOCK
            at = U(block * BLOCK_FLOATS + (y % L.BLOCK) * L.BLOCK + x % L.BLOCK)
            light = abs(acc[at + LIGHT])
            for channel in range(3):
                value = (acc[at + U(channel * L.LANES)] + light * background[channel]) * F(255) + F(0.5)
                frame[y0 + y, x0 + x, channel] = np.uint8(np.int32(min(max(value, F(0)), F(255))))


@kernel()
def write_cells(acc, x0, y0, width, height, cells):
    """Sum a tile's pixels inside the image by cell: cells [rows, columns, 2] of weight / z and of weight."""
    for cy in range(y0 // CELL, min((y0 + L.TILE) // CELL, cells.shape[0])):
        for cx in range(x0 // CELL, min((x0 + L.TILE) // CELL, cells.shape[1])):
            inverse, opacity = F(0), F(0)
            for y in range(cy * CELL - y0, min(cy * CELL + CELL, height) - y0):
                for x in range(cx * CELL - x0, min(cx * CELL + CELL, width) - x0):
                    block = (y // L.BLOCK) * L.TILE_BLOCKS + x // L.BLOCK
                    at = U(block * BLOCK_FLOATS + (y % L.BLOCK) * L.BLOCK + x % L.BLOCK)
                    inverse += acc[at + INVERSE]
                    opacity += F(1) - abs(acc[at + LIGHT])
            cells[cy, cx, 0] = inverse
            cells[cy, cx, 1] = opacity


@kernel()
def average_cells(cells, width, height, means):
    """Average cells over the pixels of a map, means [h, w, 2]. Cells that span several pixels are weighted by area."""
    rows, columns = means.shape[:2]
    across, down = width / columns, height / rows
    for row in range(rows):
        top, bottom = row * down, (row + 1) * down
        for column in range(columns):
            left, right = column * across, (column + 1) * across
            inverse, opacity = 0.0, 0.0
            for cy in range(int(top) // CELL, min(int(np.ceil(bottom / CELL)), cells.shape[0])):
                y0, y1 = cy * CELL, min(cy * CELL + CELL, height)
                share_y = max(0.0, min(bottom, y1) - max(top, y0)) / (y1 - y0)
                for cx in range(int(left) // CELL, min(int(np.ceil(right / CELL)), cells.shape[1])):
                    x0, x1 = cx * CELL, min(cx * CELL + CELL, width)
                    share = share_y * max(0.0, min(right, x1) - max(left, x0)) / (x1 - x0)
                    inverse += share * cells[cy, cx, 0]
                    opacity += share * cells[cy, cx, 1]
            means[row, column, 0] = inverse / (across * down)
            means[row, column, 1] = opacity / (across * down)
