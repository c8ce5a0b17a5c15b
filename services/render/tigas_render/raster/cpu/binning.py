"""The second and third stage: one list of Gaussians for each tile, nearest first."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import numpy as np
from numba import prange

from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.intrinsics import fetch_add, prefetch
from tigas_render.raster.cpu.kernel import kernel
from tigas_render.raster.cpu.tiles import has_corners, list_tiles

U = np.uint64
DIGIT = 8
"""Bits sorted by at once."""
DIGITS = 3
KEY_BITS = DIGIT * DIGITS
AHEAD = 16
"""Splats are prefetched this many places ahead."""


@kernel()
def place_lists(tile_counts, begin, limit, starts):
    """Turn counts [S, tiles] of tiles from `begin` on into cursors: where each slice starts to write in a tile's list.

    Stops before the lists together would exceed `limit` entries, but not before one tile; gives the tile it stopped at.
    starts [tiles + 1]: where each tile's list begins, and the end of the last.
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
    """Write the lists of tiles begin … end - 1: entries [total], the depth's bits << 32 | the splat's number.

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

    histograms [threads, DIGITS << DIGIT]; turn [1]: the next tile, `begin` at first.
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

    Depths are positive, so their bits sort as they do. The list's own range is sorted by its KEY_BITS highest bits: a
    relative precision of 2^-18 even between the near plane and the horizon.
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
