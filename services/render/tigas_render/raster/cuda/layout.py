"""Decides how a picture is cut into tiles. Pure arithmetic, so that it can be tested without a GPU."""

from __future__ import annotations

from dataclasses import dataclass

SMALL_PICTURE = 640 * 360
"""Pixels. A picture of at most so many gets small tiles, as large ones would keep few multiprocessors busy; so does one
with more Gaussians than pixels, as those are small themselves. See docs/architecture.md."""

MAX_SLICES = 256
"""A slice's number has 8 bits."""
MAX_LISTS = 1 << 18
"""Lists of all tiles and slices together: enough to keep each short, few enough to count in microseconds."""


@dataclass(frozen=True, slots=True)
class TileLayout:
    """A picture's tiles."""

    side: int
    """Pixels: 8 or 16."""
    columns: int
    rows: int
    slices: int
    """Depth is cut into so many, each with a list for every tile: a power of two, 256 at most."""

    @property
    def tiles(self) -> int:
        """How many there are."""
        return self.columns * self.rows


def tile_layout(width: int, height: int, gaussians: int) -> TileLayout:
    """The tiles of a picture of so many pixels and Gaussians."""
    side = 8 if width * height <= max(SMALL_PICTURE, gaussians) else 16
    columns, rows = -(-width // side), -(-height // side)
    slices = MAX_SLICES
    while slices > 4 and slices * columns * rows > MAX_LISTS:
        slices //= 2
    return TileLayout(side, columns, rows, slices)
