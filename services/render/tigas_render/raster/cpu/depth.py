"""From the cells that the blending stage fills to the coarser map of a view's depth."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,var-annotated"
from __future__ import annotations

import numpy as np

from tigas_render.raster.cpu.kernel import kernel

CELL = 2
"""Pixels on each side of a cell; tiles consist of whole cells, so that every cell has one writer."""


@kernel()
def average_cells(cells, width, height, means):
    """Average cells over the pixels of a map, means [h, w, 2]; a cell between several counts by area in each."""
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
