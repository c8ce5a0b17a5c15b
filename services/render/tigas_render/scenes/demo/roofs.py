"""The gallery's roofs, and the tower behind them."""

from __future__ import annotations

from typing import Any

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.materials import LIMESTONE, PLASTER, TERRACOTTA, stone
from tigas_render.scenes.demo.surfels import Floats, Surfels, box, facing, join, noise, surface


def roofs(detail: float, rng: np.random.Generator) -> Surfels:
    """Mission tiles, row over row: each tile a Gaussian across the slope, arched by its normal."""
    eave, ridge = layout.EAVES + 0.1, layout.RIDGE
    parts = []
    for half, length, turn in (
        (layout.COURT_Z, layout.OUTER_X, 0.0),
        (layout.COURT_Z, layout.OUTER_X, np.pi),
        (layout.COURT_X, layout.OUTER_Z, np.pi / 2),
        (layout.COURT_X, layout.OUTER_Z, -np.pi / 2),
    ):
        inner, outer = half - 0.35, half + layout.GALLERY + 0.4
        columns_, rows = round(2 * length / 0.24 * detail), round(13 * detail)
        deep = outer - inner

        def slope(u: Floats, v: Floats) -> tuple[Any, Any, Any]:
            z = inner + v * deep  # noqa: B023 - evaluated at once
            shorter = length - (1 - v) * deep + 0.4  # noqa: B023 - the roofs meet along the diagonals
            return (2 * u - 1) * shorter, -(eave + v * (ridge - eave)), z

        tiles = surface(slope, columns_, rows * 2, rng, jitter=0.08, overlap=0.85)
        tiles = facing(tiles, np.array([0, -1, -0.4]))
        tint = 1 + 0.3 * rng.normal(size=len(tiles)) * 0.6 + 0.15 * noise(tiles.positions, 2.0, rng)
        hollow = np.where(np.arange(len(tiles)) // (rows * 2) % 2, 0.55, 1.0)  # every second column lies hollow side up
        tiles = tiles.painted((TERRACOTTA * (tint * hollow)[:, None]).clip(0.02, 0.9).astype(np.float32))
        parts.append(tiles.moved(0, 0, 0, turn=turn))
    return join(*parts)


def tower(detail: float, rng: np.random.Generator) -> Surfels:
    """A bell tower behind the far gallery, with an open storey and a pyramid of tiles."""
    x, z, half = layout.TOWER
    high = layout.TOWER_HEIGHT
    body = box((x - half, -high, z - half), (2 * half, high, 2 * half), 0.26 / detail, rng)
    height = -body.positions[:, 1]
    colour = stone(body.positions, PLASTER * 0.95, rng, contrast=0.09)
    corner = np.stack((np.abs(body.positions[:, 0] - x), np.abs(body.positions[:, 2] - z)), 1).min(1) > half - 0.35
    colour = np.where(corner[:, None], LIMESTONE, colour)
    band = (np.abs(height - high + 3.5) < 0.15) | (height > high - 0.3)
    colour = np.where(band[:, None], LIMESTONE * 1.1, colour)
    parts = [body.where(height > 4.5).painted(colour[height > 4.5].astype(np.float32))]
    windows = _windows(half, high, detail, rng)
    for k in range(4):

        def face(u: Floats, v: Floats) -> tuple[Any, Any, Any]:
            r = (half + 0.3) * (1 - v)
            return (2 * u - 1) * r, -(high + 2.3 * v), r + 0 * u

        side = facing(surface(face, round(26 * detail), round(16 * detail), rng), np.array([0, -1, 1]))
        tint = 1 + 0.2 * rng.normal(size=len(side))
        side = side.painted((TERRACOTTA * tint[:, None]).clip(0.02, 0.9).astype(np.float32))
        parts.append(side.moved(x, 0, z, turn=k * np.pi / 2))
        parts.append(windows.moved(x, 0, z, turn=k * np.pi / 2))
    return join(*parts)


def _windows(half: float, high: float, detail: float, rng: np.random.Generator) -> Surfels:
    """One face's openings, at z = half: a pair in the belfry, and a small one below."""
    parts = []
    for middle, sill, tall, r in ((-0.85, high - 3.1, 1.3, 0.5), (0.85, high - 3.1, 1.3, 0.5), (0.0, 7.2, 0.8, 0.3)):

        def opening(u: Floats, v: Floats) -> tuple[Any, Any, Any]:
            across = 2 * u - 1
            top = tall + r * np.sqrt((1 - across**2).clip(0, None))  # noqa: B023 - evaluated at once
            return middle + r * across, -(sill + v * top), half + 0.12 + 0 * u  # noqa: B023

        def frame(u: Floats, v: Floats) -> tuple[Any, Any, Any]:
            length = 2 * tall + np.pi * r  # noqa: B023
            s = u * length
            angle = ((s - tall) / r).clip(0, np.pi)  # noqa: B023
            rise = np.where(s < tall, s, np.where(s > length - tall, length - s, tall))  # noqa: B023
            wide = r + 0.16 * v  # noqa: B023
            return middle + np.cos(angle) * wide, -(sill + rise + np.sin(angle) * wide), half + 0.17 + 0 * u  # noqa: B023

        dark = surface(opening, round(9 * detail), round(20 * detail), rng, jitter=0.1)
        parts.append(facing(dark, np.array([0, 0, 1])).painted((0.02, 0.018, 0.02)))
        stones = surface(frame, round(50 * detail), 2, rng, jitter=0.1)
        parts.append(facing(stones, np.array([0, 0, 1])).painted(stone(stones.positions, LIMESTONE * 1.1, rng)))
    return join(*parts)
