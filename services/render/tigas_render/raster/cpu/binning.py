"""The second and third stages, which make one list of Gaussians for each tile, nearest first.

A Gaussian is in the lists of the tiles that it touches, by the exact spans of its ellipse alpha ≥ 1/255 in each row of
tiles.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import numpy as np
from numba import prange

from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.kernel import bits_of, fetch_add, kernel, prefetch

U, F = np.uint64, np.float32
DIGIT = 8
"""Bits per pass of the radix sort."""
DIGITS = 3
KEY_BITS = DIGIT * DIGITS
AHEAD = 16
"""Number of splats to prefetch ahead."""


@kernel()
def place_lists(tile_counts, begin, limit, starts):
    """Turn the counts [S, tiles] of tiles from `begin` on into cursors, where each slice starts to write its entries.

    Stops before the lists together exceed `limit` entries, but not before the first tile is done. Returns the tile at
    which it stopped. starts [tiles + 1]: the start of each tile's list, and the end of the last.
    """
    total = 0
    tile = begin
    while tile < tile_counts.shape[1]:
        starts[tile] = total
        for part in range(tile_counts.shape[0]):
            total += tile_counts[part, tile]
        if total > limit and tile > begin:
            break
        total = starts[tile]
        for part in range(tile_counts.shape[0]):
            count = tile_counts[part, tile]
            tile_counts[part, tile] = total
            total += count
        tile += 1
        starts[tile] = total
    return tile


@kernel(parallel=True)
def fill_lists(splats, keys, visible, slices, cursors, tiles_x, begin, end, entries, threads, turn):
    """Write the lists of tiles begin … end - 1 as entries [total]: the depth's bits << 32 | the splat's number.

    Each slice of chosen chunks writes at its own cursors, so the order does not depend on the threads.
    """
    low = U(0xFFFFFFFF)
    for _ in prange(threads):
        while True:
            part = fetch_add(turn, 0)
            if part >= slices.shape[0] - 1:
                break
            for place in range(slices[part], slices[part + 1]):
                for splat in range(place * L.CHUNK, place * L.CHUNK + visible[place]):
                    if has_corners(keys[splat + AHEAD]):
                        prefetch(splats, (splat + AHEAD) * L.RECORD)
                    entry, box = (keys[splat] & ~low) | U(splat), keys[splat] & low
                    list_tiles(splats, splat * L.RECORD, box, entry, cursors[part], tiles_x, begin, end, entries)


@kernel(parallel=True)
def sort_lists(starts, begin, end, entries, spare, histograms, turn):
    """Sort the lists of tiles begin … end - 1 by depth, stably, from `entries` into `spare`.

    histograms [threads, DIGITS << DIGIT]. turn [1]: the next tile, initially `begin`.
    """
    for thread in prange(histograms.shape[0]):
        while True:
            tile = fetch_add(turn, 0)
            if tile >= end:
                break
            sort_list(entries, spare, starts[tile], starts[tile + 1], histograms[thread])


@kernel()
def sort_list(entries, spare, start, end, histogram):
    """Radix sort of entries[start:end] into spare[start:end].

    Depths are positive, so their bits have the same order. They are sorted by the highest KEY_BITS of the list's own
    range, which gives a relative precision of 2^-18 even between the near plane and the horizon.
    """
    if start == end:
        return
    low, high = entries[start], entries[start]
    for i in range(start, end):
        low, high = min(low, entries[i]), max(high, entries[i])
    base = low >> U(32)
    span = (high >> U(32)) - base
    shift = U(32)
    while span >> U(KEY_BITS):
        span >>= U(1)
        shift += U(1)
    base <<= U(32)
    histogram[:] = 0
    mask = U((1 << DIGIT) - 1)
    for i in range(start, end):
        key = (entries[i] - base) >> shift
        for digit in range(DIGITS):
            histogram[(U(digit) << U(DIGIT)) + ((key >> U(digit * DIGIT)) & mask)] += 1
    for digit in range(DIGITS):
        total = start
        for value in range(digit << DIGIT, (digit + 1) << DIGIT):
            count = histogram[value]
            histogram[value] = total
            total += count
    for digit in range(DIGITS):
        source, target = (entries, spare) if digit % 2 == 0 else (spare, entries)
        bits = shift + U(digit * DIGIT)
        for i in range(start, end):
            entry = source[i]
            value = (U(digit) << U(DIGIT)) + (((entry - base) >> bits) & mask)
            target[histogram[value]] = entry
            histogram[value] += 1


@kernel(exact=True)
def span(splats, at, y0, y1, x0, x1):
    """First and last + 1 of the pixel columns x0 … x1 - 1 that the splat at `at` touches in rows y0 … y1 - 1.

    The rightmost point of the ellipse a dx² + 2b dx dy + c dy² = k has dy = -b/c · dx. If that is outside the strip of
    rows, the rightmost point is on the strip's nearer edge. The leftmost point follows by symmetry.
    """
    a, b, c = -splats[at + L.XX], F(-0.5) * splats[at + L.XY], -splats[at + L.YY]
    k = splats[at + L.LOG] - F(L.LOG_ALPHA_MIN)
    u, v = splats[at + L.CENTRE_X], splats[at + L.CENTRE_Y]
    low, high = F(y0) + F(0.5) - v, F(y1) - F(0.5) - v
    determinant = a * c - b * b
    if not determinant > F(1e-30):  # far larger than any image
        return x0, x1
    widest = -b * np.sqrt(k / (c * determinant))
    right_dy = min(max(widest, low), high)
    left_dy = min(max(-widest, low), high)
    right = (-b * right_dy + np.sqrt(max(a * k - determinant * right_dy * right_dy, F(0)))) / a
    left = (-b * left_dy - np.sqrt(max(a * k - determinant * left_dy * left_dy, F(0)))) / a
    # widened by a hundredth of a pixel, because of rounding; clamped before the conversion to int
    first = max(x0, int(min(max(u + left + F(0.49), F(x0)), F(x1))))
    end = min(x1, int(min(max(u + right + F(0.51), F(x0)), F(x1))))
    return first, end


@kernel()
def count_tiles(splats, at, counts, tiles_x):
    """Add 1 to the counter of every tile that the splat at `at` touches. Returns the box of these tiles in 32 bits."""
    x0, x1, y0, y1 = pixel_box(splats, at)
    tx0, tx1, ty0, ty1 = x0 // L.TILE, (x1 - 1) // L.TILE, y0 // L.TILE, (y1 - 1) // L.TILE
    for ty in range(ty0, ty1 + 1):
        first, last = tx0, tx1
        if tx0 < tx1 and ty0 < ty1:
            first, last = tile_span(splats, at, ty)
        for tile in range(ty * tiles_x + first, ty * tiles_x + last + 1):
            counts[tile] += 1
    return U(tx0) | U(ty0) << U(8) | U(tx1) << U(16) | U(ty1) << U(24)


@kernel(inline=True)
def list_tiles(splats, at, box, entry, cursors, tiles_x, begin, end, entries):
    """Append `entry` to the lists of the tiles `begin` … `end` - 1 that count_tiles counted, at their cursors.

    box: the result of count_tiles. The splat is examined only if it may not touch the corners of the box.
    """
    byte = U(0xFF)
    tx0, ty0 = np.int64(box & byte), np.int64(box >> U(8) & byte)
    tx1, ty1 = np.int64(box >> U(16) & byte), np.int64(box >> U(24) & byte)
    for ty in range(ty0, ty1 + 1):
        first, last = tx0, tx1
        if tx0 < tx1 and ty0 < ty1:
            first, last = tile_span(splats, at, ty)
        for tile in range(max(begin, ty * tiles_x + first), min(end, ty * tiles_x + last + 1)):
            cursor = cursors[tile]
            entries[cursor] = entry
            cursors[tile] = cursor + 1


@kernel(inline=True)
def has_corners(box):
    """Whether a box of tiles, in the lower 32 bits, has at least two rows and two columns."""
    difference = (box >> U(16)) ^ box
    return difference & U(0xFF) != U(0) and difference & U(0xFF00) != U(0)


@kernel(exact=True)
def tile_span(splats, at, ty):
    """First and last tile column that the splat at `at` touches in the tile row ty.

    Compiled as exact, because count_tiles and list_tiles must get the same result.
    """
    x0, x1, y0, y1 = pixel_box(splats, at)
    left, right = span(splats, at, max(y0, ty * L.TILE), min(y1, ty * L.TILE + L.TILE), x0, x1)
    return left // L.TILE, (right - 1) // L.TILE


@kernel(inline=True)
def pixel_box(splats, at):
    """x0, x1, y0, y1 such that the splat touches no pixel outside columns x0 … x1 - 1 and rows y0 … y1 - 1."""
    columns, rows = bits_of(splats[at + L.COLUMNS]), bits_of(splats[at + L.ROWS])
    mask, shift = np.uint32(0xFFFF), np.uint32(16)
    return np.int64(columns & mask), np.int64(columns >> shift), np.int64(rows & mask), np.int64(rows >> shift)
