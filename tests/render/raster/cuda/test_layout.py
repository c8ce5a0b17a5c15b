"""Tiles cover the picture and fit the kernels."""

from __future__ import annotations

import pytest

from tigas_render.raster.cuda import layout
from tigas_render.raster.cuda.layout import tile_layout

SIZES = [(1, 1), (320, 180), (640, 360), (1280, 720), (1920, 1080), (3840, 2160), (8192, 2048), (2048, 8192)]


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_tiles_cover_the_picture_and_their_lists_fit_the_kernels(width: int, height: int) -> None:
    tiles = tile_layout(width, height, 100_000)
    assert tiles.columns * tiles.side >= width > (tiles.columns - 1) * tiles.side
    assert tiles.rows * tiles.side >= height > (tiles.rows - 1) * tiles.side
    assert tiles.slices in {4, 8, 16, 32, 64, 128, 256}
    assert tiles.tiles * tiles.slices <= layout.MAX_LISTS or tiles.slices == 4


def test_small_pictures_and_small_gaussians_have_small_tiles() -> None:
    assert [tile_layout(width, height, 100_000).side for width, height in SIZES[:4]] == [8, 8, 8, 16]
    assert tile_layout(1280, 720, 3_000_000).side == 8
