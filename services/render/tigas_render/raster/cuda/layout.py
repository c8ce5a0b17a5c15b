"""Decides how a picture is cut into tiles. Pure arithmetic, so that it can be tested without a GPU."""

from __future__ import annotations

from dataclasses import dataclass

SMALL_TILE_PIXELS = 400 * 225
"""Pictures of at most so many pixels get small tiles: with large ones they would keep few multiprocessors busy, and
each tile's list would be long. Measured, see docs/gpu.md."""


@dataclass(frozen=True, slots=True)
class TileLayout:
    """A picture's tiles."""

    side: int
    """Pixels: 8 or 16."""
    columns: int
    rows: int

    @property
    def tiles(self) -> int:
        """How many there are."""
        return self.columns * self.rows


def tile_layout(width: int, height: int) -> TileLayout:
    """The tiles of a picture of so many pixels."""
    side = 8 if width * height <= SMALL_TILE_PIXELS else 16
    return TileLayout(side, -(-width // side), -(-height // side))
