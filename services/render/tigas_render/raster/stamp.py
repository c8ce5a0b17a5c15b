"""A number drawn into a frame, so that a test can read from the pixels on a screen which request they answer.

One row of 32 square cells along the upper edge: white, black, white, black; the number's 24 bits, the most significant
first, white for 1; and 4 bits of checksum, the exclusive or of the number's six groups of four bits. Cells are a
thirty-second of the frame's width, whatever its resolution, and so survive the lowest quality and any scaling.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CELLS = 32
BITS = 24
_FINDER = [1, 0, 1, 0]


def draw_stamp(pixels: NDArray[np.uint8], number: int) -> None:
    """Draw `number` (0 to 2²⁴−1) into RGB pixels, uint8 [H, W, 3]."""
    edges = np.round(np.arange(CELLS + 1) * pixels.shape[1] / CELLS).astype(int)
    row = np.zeros((pixels.shape[1], 1), np.uint8)
    for left, right, cell in zip(edges, edges[1:], _cells(number), strict=False):
        row[left:right] = 255 * cell
    pixels[: edges[1]] = row


def read_stamp(pixels: NDArray[np.uint8]) -> int | None:
    """The number in RGB pixels, uint8 [H, W, 3], of any size; None if there is none that can be read."""
    side = pixels.shape[1] / CELLS
    centres = ((np.arange(CELLS) + 0.5) * side).astype(int)
    cells = [int(pixels[int(side / 2), centre].mean() > 127) for centre in centres]
    number = int("".join(map(str, cells[len(_FINDER) : len(_FINDER) + BITS])), 2)
    return number if cells == _cells(number) else None


def _cells(number: int) -> list[int]:
    checksum = 0
    for shift in range(0, BITS, 4):
        checksum ^= number >> shift & 0xF
    return [*_FINDER, *_bits(number, BITS), *_bits(checksum, 4)]


def _bits(value: int, count: int) -> list[int]:
    return [value >> place & 1 for place in reversed(range(count))]
