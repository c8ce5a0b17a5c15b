"""Copies of a scene side by side, which make large scenes for tests and measurements."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tigas_common.wire.model import Point
from tigas_render.gaussians import Gaussians
from tigas_render.raster.morton import morton_codes
from tigas_render.scenes.compressed_ply import CHUNK, write_compressed_ply
from tigas_render.scenes.ply import ANTIALIASED
from tigas_render.scenes.start_view.view import level_frame

CENTRAL_QUANTILES = (0.01, 0.99)
"""Quantiles of the centres that bound a copy, because a few Gaussians may be far away."""


def write_grid(path: Path, scene: Gaussians, up: Point, columns: int, rows: int) -> int:
    """Write columns × rows copies of a scene on its ground plane as a compressed PLY. Returns the number of Gaussians.

    Each copy may be padded with transparent Gaussians. Uses the memory of one copy. Raises OSError.
    """
    frame = level_frame(np.array(up, np.float64))
    order = np.argsort(morton_codes(scene.means), kind="stable")
    padding = -len(order) % CHUNK
    order = np.concatenate((order, np.repeat(order[-1], padding)))
    whole = Gaussians(*(array[order] for array in scene.arrays), antialiased=scene.antialiased)
    whole.opacities[len(scene) :] = 0
    low, high = np.quantile(scene.means @ frame.T, CENTRAL_QUANTILES, axis=0)
    right, forward = (frame[axis] * (high - low)[axis] for axis in (0, 2))
    shifts = [right * column + forward * row for row in range(rows) for column in range(columns)]
    part = path.with_name(f".{path.name}.part")
    comments = [ANTIALIASED] if scene.antialiased else []
    try:
        write_compressed_ply(part, whole, np.arange(len(whole)), comments, np.array(shifts, np.float32))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return len(whole) * len(shifts)
