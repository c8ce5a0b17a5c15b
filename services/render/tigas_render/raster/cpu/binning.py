"""The second and third stage: one list of Gaussians for each tile, nearest first."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import numpy as np
from numba import prange

from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu.intrinsics import bits_of, fetch_add
from tigas_render.raster.cpu.kernel import kernel
from tigas_render.raster.cpu.tiles import list_tiles

U = np.uint64
DIGIT = 8
"""Bits sorted by at once."""
DIGITS = 3
KEY_BITS = DIGIT * DIGITS


@kernel()
def place_lists(tile_counts, starts):
    """Turn counts [S, tiles] into cursors: where each slice begins to write in each tile's list. Gives the total.

    starts [tiles + 1]: where each tile's list begins.
    """
    total = 0
    for tile in range(tile_counts.shape[1]):
        starts[tile] = total
        for part in range(tile_counts.shape[0]):
            count = tile_counts[part, tile]
            tile_counts[part, tile] = total
            total += count
    starts[tile_counts.shape[1]] = total
    return total


@kernel(parallel=True)
def fill_lists(splats, visible, slices, cursors, tiles_x, entries, threads, turn):
    """Write every tile's list: entries [total] uint64, the depth's bits << 32 | the record's number.

    Each slice of chunks writes at its own cursors, so the order does not depend on the threads.
    """
    for _ in prange(threads):
        while True:
            part = fetch_add(turn, 0)
            if part >= slices.shape[0] - 1:
                break
            for chunk in range(slices[part], slices[part + 1]):
                for record in range(chunk * L.CHUNK, chunk * L.CHUNK + visible[chunk]):
                    at = record * L.RECORD
                    entry = (U(bits_of(splats[at + L.DEPTH])) << U(32)) | U(record)
                    list_tiles(splats, at, entry, cursors[part], tiles_x, entries)


@kernel(parallel=True)
def sort_lists(starts, entries, spare, histograms, turn):
    """Sort each tile's list by depth, stably, from `entries` into `spare`; histograms [threads, DIGITS << DIGIT]."""
    for thread in prange(histograms.shape[0]):
        while True:
            tile = fetch_add(turn, 0)
            if tile >= starts.shape[0] - 1:
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
