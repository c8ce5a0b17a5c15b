"""The court's paving, the basin, and the fountain in it."""

from __future__ import annotations

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.materials import LIMESTONE, OCHRE, TILE_BLUE, grain, stone
from tigas_render.scenes.demo.surfels import Surfels, facing, join, rectangle, strokes, turned


def ground(detail: float, rng: np.random.Generator) -> Surfels:
    """What is underfoot in the open court, except the water."""
    return join(court_floor(detail, rng), basin(detail, rng), fountain(detail, rng))


def court_floor(detail: float, rng: np.random.Generator) -> Surfels:
    """The paving between the colonnades, around the basin."""
    x, z = layout.COURT_X - 0.3, layout.COURT_Z - 0.3
    bx, bz = (
        layout.BASIN_X + layout.RIM + 0.08,
        layout.BASIN_Z + layout.RIM + 0.08,
    )  # the slabs' soft edge ends at the rim
    parts = []
    for x0, x1, z0, z1 in ((-x, x, -z, -bz), (-x, x, bz, z), (-x, -bx, -bz, bz), (bx, x, -bz, bz)):
        parts += _paving(x0, x1, z0, z1, 0.0, 0.8, detail, rng)
    return join(*parts)


def _paving(
    x0: float, x1: float, z0: float, z1: float, y: float, slab: float, detail: float, rng: np.random.Generator
) -> list[Surfels]:
    """Slabs, each with a tint of its own, the dark joints between them, and the marks of many feet."""
    slabs = rectangle((x0, y, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), 0.14 / detail, rng, jitter=0.3)
    cell = np.floor(slabs.positions[:, [0, 2]] / slab).astype(np.int64)
    tint = np.sin(cell @ np.array([12.9898, 78.233]) * 43.7) * 0.5 + np.sin(cell @ np.array([3.7, 9.1]) * 17.3) * 0.5
    warm = np.where((np.sin(cell @ np.array([7.3, 5.9]) * 29.1) > 0.55)[:, None], np.array([1.03, 0.92, 0.8]), 1.0)
    colour = LIMESTONE * 0.8 * (1 + 0.16 * tint)[:, None] * warm
    slabs = slabs.painted(stone(slabs.positions, colour, rng, contrast=0.06), gloss=0.7)
    if detail < 0.7:
        return [slabs]
    return [slabs, _joints(x0, x1, z0, z1, y - 0.012, slab), grain(slabs, 0.5, 0.012, rng)]


def _joints(x0: float, x1: float, z0: float, z1: float, y: float, slab: float) -> Surfels:
    xs = np.arange(np.ceil(x0 / slab), np.floor(x1 / slab) + 1) * slab
    zs = np.arange(np.ceil(z0 / slab), np.floor(z1 / slab) + 1) * slab
    along_z = [(x, y, z0, x, y, z1) for x in xs]
    along_x = [(x0, y, z, x1, y, z) for z in zs]
    lines = []
    for group, length in ((along_z, z1 - z0), (along_x, x1 - x0)):
        if group:
            ends = np.array(group, np.float64)
            lines.append(strokes(ends[:, :3], ends[:, 3:], 0.009, (0, -1, 0), pieces=max(1, round(length / 0.3))))
    return join(*lines).painted(tuple(LIMESTONE * 0.34), opacity=0.75)


def basin(detail: float, rng: np.random.Generator) -> Surfels:
    """The rim around the water: polished coping over tiled sides."""
    x, z, rim, high = layout.BASIN_X, layout.BASIN_Z, layout.RIM, layout.RIM_HEIGHT
    parts = []
    for x0, x1, z0, z1 in (
        (-x - rim, x + rim, -z - rim, -z),
        (-x - rim, x + rim, z, z + rim),
        (-x - rim, -x, -z, z),
        (x, x + rim, -z, z),
    ):
        coping = rectangle((x0, -high, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), 0.085 / detail, rng)
        parts.append(coping.painted(stone(coping.positions, LIMESTONE * 0.8, rng, contrast=0.05), gloss=0.6))
    for inside, hx, hz in ((True, x, z), (False, x + rim, z + rim)):
        for corner, along, normal in (
            ((-hx, -high, -hz), (2 * hx, 0, 0), (0, 0, -1)),
            ((-hx, -high, hz), (2 * hx, 0, 0), (0, 0, 1)),
            ((-hx, -high, -hz), (0, 0, 2 * hz), (-1, 0, 0)),
            ((hx, -high, -hz), (0, 0, 2 * hz), (1, 0, 0)),
        ):
            down = high - layout.WATER + 0.06 if inside else high
            side = rectangle(corner, along, (0, down, 0), 0.04 / detail, rng, jitter=0.0, overlap=0.62)
            side = facing(side, np.asarray(normal, np.float32) * (-1 if inside else 1))
            run = side.positions[:, 0] if along[0] else side.positions[:, 2]
            tile = (np.floor(run / 0.2) + np.floor((side.positions[:, 1] + high) / 0.2)).astype(np.int64) % 2
            cross = (
                np.maximum(np.abs(run / 0.2 % 1 - 0.5), np.abs((side.positions[:, 1] + high) / 0.2 % 1 - 0.5)) < 0.25
            )
            colour = np.where(tile[:, None], TILE_BLUE * 1.4, LIMESTONE * 0.95)
            colour = np.where((cross & (tile == 0))[:, None], OCHRE * 0.9, colour)
            parts.append(side.painted(stone(side.positions, colour, rng, contrast=0.06), gloss=0.4))
    return join(*parts)


def fountain(detail: float, rng: np.random.Generator) -> Surfels:
    """Two bowls on a turned stem in the middle of the basin."""
    profile = [
        (0.42, 0.1),
        (0.42, 0.4),
        (0.3, 0.46),
        (0.17, 0.55),
        (0.14, 0.75),
        (0.2, 0.84),
        (0.75, 0.98),
        (0.86, 1.08),
        (0.83, 1.1),
        (0.7, 1.05),
        (0.16, 1.04),
        (0.11, 1.2),
        (0.1, 1.4),
        (0.14, 1.45),
        (0.36, 1.53),
        (0.4, 1.6),
        (0.37, 1.61),
        (0.3, 1.57),
        (0.05, 1.56),
        (0.06, layout.FOUNTAIN_HEIGHT),
    ]
    body = turned(profile, round(44 * detail), 0.045 / detail, rng, jitter=0.15)
    return body.painted(stone(body.positions, LIMESTONE * 1.05, rng, contrast=0.07), gloss=0.45)
