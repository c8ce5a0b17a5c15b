"""Places at which a capture surrounds the viewer, and the eye height there.

All coordinates are right, down and forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tigas_render.scenes.start_view.grid import Cells, Flags, Grid, Hits
from tigas_render.scenes.start_view.surfels import Doubles

COLUMNS, ROWS = 16, 12
"""Resolution of the lattice of places that are tried."""
AZIMUTHS = 12
BELOW, ABOVE = (-60, -35, -18, -7), (9, 16, 24)
"""Elevations of rays in degrees."""
STEEP = 2
"""Number of elevations, the steepest, at which distant surroundings do not count as ground."""
GROUND, WALLS, SIGHT = 0.93, 0.5, 0.08
"""Minimum shares of hits below and just above the horizon, and minimum viewing distance in sizes of the capture."""
MIN_PLACES = 4
SMALLER = 0.35
"""Minimum difference between log sizes seen from outside and inside: captures are sharpest near their cameras."""
OUTSIDE = 18
"""Number of views of the whole capture from outside."""
ROOM = 3.0
"""Size, half the diagonal in metres, above which a closed hollow capture is a room."""
CEILED = 0.7
"""Share of places with a ceiling above which the capture is a room."""
EYE_M, METRIC_M = 1.65, (0.55, 5.0)
"""Usual eye height in metres, and the range of estimates that may be in metres."""
OFF_LEVEL = 0.25
"""Tolerated difference between a place's ground and the median ground, in eye heights."""


@dataclass(frozen=True, slots=True)
class Places:
    """P places inside a capture, at eye height."""

    points: Doubles
    """[P, 3] positions."""
    penalties: Doubles
    """[P] penalties for ground that is not at the usual height."""
    eye: float
    """Eye height above the ground, in scene units."""
    ceiled: bool


def find_places(grid: Grid, whole: Grid) -> Places | None:
    """The places at which a visitor may stand; None for an object, which should be seen from outside.

    grid: the middle of the capture. whole: the capture with its surroundings.
    """
    points = grid.lattice(COLUMNS, ROWS)
    points = points[grid.clearance(points) >= 2 * grid.cell]
    if not len(points):
        return None
    enclosed, sights, hits = _enclosed(grid, points)
    closed_room = enclosed.mean() > 0.5 and grid.size > ROOM
    sharper = closed_room or _is_sharper_inside(grid, hits.cells.reshape(len(points), -1)[enclosed], whole)
    if enclosed.sum() < MIN_PLACES or not sharper:
        return None
    points, sights = points[enclosed], sights[enclosed]
    ground, ceiling = _vertical_distance(grid, points, 1.0), _vertical_distance(grid, points, -1.0)
    ceiled = float(np.isfinite(ceiling).mean()) > CEILED
    if ceiled:
        gaps = ground + ceiling
        eye = float(np.median(gaps[np.isfinite(gaps)])) / 2 if np.isfinite(gaps).any() else float(np.median(sights)) / 5
    else:
        eye = float(np.median(sights)) / 5
        if METRIC_M[0] < eye < METRIC_M[1]:
            eye = math.sqrt(eye * EYE_M)
    return _on_the_ground(grid, points, ground, eye, ceiled) or Places(points, np.zeros(len(points)), eye, ceiled)


def _on_the_ground(grid: Grid, points: Doubles, ground: Doubles, eye: float, ceiled: bool) -> Places | None:
    """The places, moved to eye height above their ground; None if no place is left."""
    points, ground = points[np.isfinite(ground)], ground[np.isfinite(ground)]
    if not len(points):
        return None
    floors = points[:, 1] + ground
    off = np.abs(floors - np.median(floors)) / eye
    penalties = 1.2 * (off - OFF_LEVEL).clip(0) * (1 if ceiled else 1 / 3)
    points = np.column_stack((points[:, 0], floors - eye, points[:, 2]))
    _, first = np.unique(points.round(6), axis=0, return_index=True)
    points, penalties = points[first], penalties[first]
    free = grid.clearance(points) >= min(2 * grid.cell, 0.3 * eye)
    points, penalties = points[free], penalties[free]
    if not len(points):
        return None
    enclosed, _, _ = _enclosed(grid, points)
    if enclosed.any():
        points, penalties = points[enclosed], penalties[enclosed]
    return Places(points, penalties, eye, ceiled)


def rays(elevations: tuple[float, ...], azimuths: int) -> Doubles:
    """[E, A, 3] unit directions at elevations in degrees and equally spaced azimuths, from forward to the right."""
    up = np.radians(elevations)[:, None]
    turn = 2 * np.pi * np.arange(azimuths) / azimuths
    directions = np.broadcast_arrays(np.cos(up) * np.sin(turn), -np.sin(up), np.cos(up) * np.cos(turn))
    return np.stack(directions, -1)


def trace_all(grid: Grid, points: Doubles, directions: Doubles) -> Hits:
    """Hits of all directions [D, 3] from each of the points [P, 3], point by point."""
    origins = np.repeat(points, len(directions), 0)
    return grid.trace(origins, np.tile(directions, (len(points), 1)))


def median_distance(distances: Doubles, otherwise: float) -> Doubles:
    """[P] median of the finite distances in [P, D]; `otherwise` if all are infinite."""
    seen = np.isfinite(distances)
    ordered = np.sort(distances, axis=1)
    middle = ordered[np.arange(len(distances)), (seen.sum(1) - 1).clip(0) // 2]
    return np.where(seen.any(1), middle, otherwise)


def _enclosed(grid: Grid, points: Doubles) -> tuple[Flags, Doubles, Hits]:
    """[P] whether the capture surrounds each point, [P] the median viewing distance there, and the hits."""
    directions = rays((*BELOW, *ABOVE), AZIMUTHS).reshape(-1, 3)
    hits = trace_all(grid, points, directions)
    covered = hits.covered.reshape(len(points), -1)
    below = len(BELOW) * AZIMUTHS
    sights = median_distance(hits.distances.reshape(len(points), -1), 3 * grid.size)
    steep = np.isfinite(hits.distances).reshape(len(points), -1)[:, : STEEP * AZIMUTHS].mean(1) > GROUND
    enclosed = steep & (covered[:, :below].mean(1) > GROUND) & (covered[:, below:].mean(1) > WALLS)
    return enclosed & (sights > SIGHT * grid.size), sights, hits


def _vertical_distance(grid: Grid, points: Doubles, down: float) -> Doubles:
    """[P] distance to the surface directly below (down = 1) or above (down = -1)."""
    direction = np.array([[1e-4, down, 1e-4]])
    return trace_all(grid, points, direction / np.linalg.norm(direction)).distances


def _is_sharper_inside(grid: Grid, cells: Cells, whole: Grid) -> bool:
    """Whether the Gaussians seen from inside, in cells [P, D], are clearly smaller than those seen from outside."""
    k = np.arange(OUTSIDE)
    height = -0.15 - 0.8 * (k + 0.5) / OUTSIDE  # from above the horizon, since captures are not viewed from below
    turn = k * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(1 - height**2)
    back = np.stack((across * np.sin(turn), height, across * np.cos(turn)), 1)
    half = np.array(whole.shape) * whole.cell / 2
    centre = whole.low + half
    spread = np.linspace(-0.9, 0.9, 6)
    targets = centre + half * np.stack(np.meshgrid(spread, spread, spread, indexing="ij"), -1).reshape(-1, 3)
    origins = np.repeat(centre + back * 3 * np.linalg.norm(half), len(targets), 0)
    directions = np.tile(targets, (OUTSIDE, 1)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    inside, outside = _mean_size(grid, cells.ravel()), _mean_size(whole, whole.trace(origins, directions).cells)
    return inside + SMALLER < outside


def _mean_size(grid: Grid, cells: Cells) -> float:
    """Mean logarithm of the sizes of the Gaussians in these cells."""
    seen = cells[cells >= 0]
    return float(grid.log_sizes[seen].mean()) if len(seen) else math.inf
