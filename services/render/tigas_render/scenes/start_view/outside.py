"""The start view of an object: from outside, slightly above, on the side with the most to see.

All coordinates are right, down and forward.
"""

from __future__ import annotations

import math

import numpy as np

from tigas_render.scenes.start_view.surfels import Doubles

SAMPLE = 10_000
AZIMUTHS = 16
TAN_Y, TAN_X = math.tan(math.radians(30)), math.tan(math.radians(40))
"""Half the vertical field of view, 60°, and half a horizontal one that all screens have except phones held upright."""
ELEVATION, FLAT_ELEVATION = math.radians(12), math.radians(32)
FLAT = 0.3
"""Ratio of height to width below which an object is flat."""
FITTING, FLAT_FITTING, MARGIN = 0.985, 0.95, 1.1
"""Share of the Gaussians that must fit in the image, for tall and for flat objects, and the space around them."""
FRONT_BIAS = 0.12
"""Bonus for a view along +z, the front in capture tools and azimuth 0 of the protocol."""


def view_from_outside(points: Doubles, radius: float) -> tuple[Doubles, Doubles]:
    """Position and focus, [3] each, for the Gaussians' centres [S, 3] and typical radius."""
    points = points[:: -(-len(points) // SAMPLE)]
    low, high = np.quantile(points, (0.015, 0.985), axis=0)
    centre, half = (low + high) / 2, (high - low) / 2
    size = max(float(np.linalg.norm(half)), 3 * radius, 1e-3 * float(np.linalg.norm(centre)), 1e-6)
    reach = float(half[[0, 2]].max())
    flat = float(half[1]) < FLAT * reach
    elevation, fitting = (FLAT_ELEVATION, FLAT_FITTING) if flat else (ELEVATION, FITTING)
    turns = [2 * math.pi * k / AZIMUTHS for k in range(AZIMUTHS)]
    backs = [_back_direction(turn, elevation) for turn in turns]
    distances = [max(MARGIN * _fitting_distance(points - centre, back, fitting), size / 4 + reach) for back in backs]
    best, best_score = 0, -1.0
    for k, (turn, back) in enumerate(zip(turns, backs, strict=True)):
        # all from the same distance, because more is visible from farther away
        score = _visible_share(points, centre + max(distances) * back) * (1 + FRONT_BIAS * math.cos(turn))
        if score > best_score + 1e-9:
            best, best_score = k, score
    return centre + distances[best] * backs[best], centre


def _back_direction(turn: float, elevation: float) -> Doubles:
    """[3] direction from the object to a camera at an elevation that looks along an azimuth, both in radians."""
    level = math.cos(elevation)
    return np.array([-math.sin(turn) * level, -math.sin(elevation), -math.cos(turn) * level])


def _fitting_distance(points: Doubles, back: Doubles, share: float) -> float:
    """Distance along `back` from which this share of the points [S, 3] around the origin is in the image."""
    right = np.array([-back[2], 0.0, back[0]])
    right /= np.linalg.norm(right)
    down = np.cross(right, back)
    beside = np.maximum(np.abs(points @ right) / TAN_X, np.abs(points @ down) / TAN_Y)
    return float(np.quantile(points @ back + beside, share))


def _visible_share(points: Doubles, position: Doubles) -> float:
    """Share of the points that are not hidden behind others, from a panoramic depth buffer of 96 × 48 directions."""
    columns, rows = 96, 48
    to = points - position
    distance = np.linalg.norm(to, axis=1).clip(min=1e-12)
    column = ((np.arctan2(to[:, 0], to[:, 2]) / (2 * math.pi) + 0.5) * columns).astype(np.int64).clip(0, columns - 1)
    row = ((np.arcsin((to[:, 1] / distance).clip(-1, 1)) / math.pi + 0.5) * rows).astype(np.int64).clip(0, rows - 1)
    cell = row * columns + column
    nearest = np.full(rows * columns, math.inf)
    np.minimum.at(nearest, cell, distance)
    # a cell is wider than most Gaussians, so points slightly behind its nearest one are next to it, not hidden
    return float(np.mean(distance <= 1.05 * nearest[cell]))
