"""Where things stand in the courtyard, in metres: y points down, the floor is y = 0, one enters looking along +z."""

from __future__ import annotations

import numpy as np

from tigas_render.scenes.demo.surfels import Floats, unit

BAY = 2.4
"""Distance between the axes of two columns."""
BAYS_X, BAYS_Z = 7, 9
COURT_X, COURT_Z = BAY * BAYS_X / 2, BAY * BAYS_Z / 2
"""Half sides of the open court, measured to the axes of its columns."""
GALLERY = 3.0
OUTER_X, OUTER_Z = COURT_X + GALLERY, COURT_Z + GALLERY
"""Half sides of the gallery's outer walls."""
COLUMN_RADIUS = 0.19
WALL_DEPTH = 0.44
"""Thickness of the wall over the arches."""
ARCH_RADIUS = BAY / 2 - 0.24
SPRING = 2.75
"""Height at which the arches begin."""
CEILING = 4.45
EAVES = 5.0
"""Height of the wall over the arches."""
RIDGE = 6.7
"""Height of the roof where it meets the outer wall."""

BASIN_X, BASIN_Z = 2.1, 6.0
"""Half sides of the water."""
RIM = 0.4
WATER = 0.28
"""Height of the water's surface."""
RIM_HEIGHT = 0.42

TOWER = (7.6, 17.2, 2.3)
"""x, z and half side of the tower behind the far gallery."""
TOWER_HEIGHT = 13.5

SUN = unit(np.array([-0.62, -0.66, -0.30]))
"""Direction to the sun."""


def bay_centres(bays: int) -> Floats:
    """[bays] positions of the arches' axes along one side."""
    return ((np.arange(bays) - (bays - 1) / 2) * BAY).astype(np.float32)


def column_places() -> Floats:
    """[M, 3] feet of the columns, each corner once."""
    xs = (np.arange(BAYS_X + 1) - BAYS_X / 2) * BAY
    zs = (np.arange(1, BAYS_Z) - BAYS_Z / 2) * BAY
    ends = [(x, 0.0, side * COURT_Z) for side in (-1, 1) for x in xs]
    sides = [(side * COURT_X, 0.0, z) for side in (-1, 1) for z in zs]
    return np.array(ends + sides, np.float32)


def lamp_places() -> Floats:
    """[M, 3] centres of the lanterns that hang in every other bay of the gallery."""
    middle = GALLERY / 2
    xs, zs = bay_centres(BAYS_X)[::2], bay_centres(BAYS_Z)[::2]
    ends = [(x, -3.1, side * (COURT_Z + middle)) for side in (-1, 1) for x in xs]
    sides = [(side * (COURT_X + middle), -3.1, z) for side in (-1, 1) for z in zs]
    return np.array(ends + sides, np.float32)


TREES = ((-5.6, 6.4, 3.3, 1.75), (5.5, -6.9, 3.0, 1.5))
"""x, z, height of the crown's centre and its radius."""
POTS = tuple((side * 3.35, z) for side in (-1, 1) for z in (-5.1, -1.7, 1.7, 5.1))
"""x and z of the orange trees in pots."""
POT_CROWN = (1.62, 0.5)
"""Height and radius of an orange tree's crown."""
FOUNTAIN_HEIGHT = 1.75
