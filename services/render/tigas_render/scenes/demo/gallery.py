"""The gallery behind the arcades: floor, walls with doors, ceiling, benches and lanterns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.materials import IRON, LIMESTONE, OCHRE, PLASTER, TILE_BLUE, WOOD, grain, stone
from tigas_render.scenes.demo.surfels import (
    Floats,
    Point,
    Surfels,
    blobs,
    box,
    facing,
    flat,
    join,
    rectangle,
    scatter,
    surface,
    turned,
)


def gallery(detail: float, rng: np.random.Generator) -> Surfels:
    """All of it."""
    parts = [gallery_floor(detail, rng), outer_walls(detail, rng), ceiling(detail, rng), lanterns(rng)]
    if detail > 0.7:
        parts += [doors(rng), benches(rng)]
    return join(*parts)


def gallery_floor(detail: float, rng: np.random.Generator) -> Surfels:
    """One step up: a chequered floor, with a kerb of limestone under the columns."""
    step, tile = -0.14, 0.6
    x, z, ox, oz = layout.COURT_X - 0.3, layout.COURT_Z - 0.3, layout.OUTER_X, layout.OUTER_Z
    tiles = []
    for x0, x1, z0, z1 in ((-ox, ox, -oz, -z), (-ox, ox, z, oz), (-ox, -x, -z, z), (x, ox, -z, z)):
        part = rectangle((x0, step, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), 0.15 / detail, rng, jitter=0.1, overlap=0.7)
        cell = np.floor((part.positions[:, [0, 2]] - np.array([x0, z0])) / tile).astype(np.int64)
        odd = (cell.sum(1) % 2)[:, None]
        tint = 1 + 0.1 * np.sin(cell @ np.array([12.99, 78.23]) * 43.7)[:, None]
        colour = np.where(odd, OCHRE * 0.72, LIMESTONE * 0.9) * tint
        inner = np.maximum(np.abs(part.positions[:, 0]) - x, np.abs(part.positions[:, 2]) - z) < 0.6
        colour = np.where(inner[:, None], LIMESTONE, colour)
        tiles.append(part.painted(stone(part.positions, colour, rng, contrast=0.05), gloss=0.8))
    floor = join(*tiles)
    edges: list[tuple[Point, Point, Point]] = [
        ((-x, step, -z), (2 * x, 0, 0), (0, 0, 1)),
        ((-x, step, z), (2 * x, 0, 0), (0, 0, -1)),
        ((-x, step, -z), (0, 0, 2 * z), (1, 0, 0)),
        ((x, step, -z), (0, 0, 2 * z), (-1, 0, 0)),
    ]
    parts = [floor, grain(floor, 0.3 * detail, 0.012, rng)]
    for corner, along, normal in edges:
        edge = rectangle(corner, along, (0, -step, 0), 0.07 / detail, rng)
        parts.append(facing(edge, np.array(normal)).painted(stone(edge.positions, LIMESTONE, rng)))
    return join(*parts)


def outer_walls(detail: float, rng: np.random.Generator) -> Surfels:
    """The gallery's back walls: an ochre wainscot under a band of tiles, and warm plaster above."""
    x, z, high = layout.OUTER_X, layout.OUTER_Z, layout.CEILING + 0.3
    sides: list[tuple[Point, Point, Point]] = [
        ((-x, 0, -z), (2 * x, 0, 0), (0, 0, 1)),
        ((-x, 0, z), (2 * x, 0, 0), (0, 0, -1)),
        ((-x, 0, -z), (0, 0, 2 * z), (1, 0, 0)),
        ((x, 0, -z), (0, 0, 2 * z), (-1, 0, 0)),
    ]
    parts = []
    for (x0, _, z0), along, normal in sides:
        out = np.array(normal)

        def strip(low: float, top: float, spacing: float, thick: float = 0.0, jitter: float = 0.2) -> Surfels:
            corner = (x0 + thick * normal[0], -top, z0 + thick * normal[2])  # noqa: B023 - used at once
            return facing(rectangle(corner, along, (0, top - low, 0), spacing, rng, jitter=jitter), out)  # noqa: B023

        plaster, wainscot = strip(1.3, high, 0.2 / detail), strip(0, 1.2, 0.15 / detail)
        wall = join(
            plaster.painted(stone(plaster.positions, PLASTER * 0.95, rng, contrast=0.07)),
            wainscot.painted(stone(wainscot.positions, OCHRE, rng, contrast=0.07)),
        )
        band = strip(1.18, 1.34, 0.054 / detail, thick=0.03, jitter=0.05)
        run = band.positions[:, 0] if along[0] else band.positions[:, 2]
        diamond = np.abs((run / 0.324) % 1 - 0.5) * 2 + np.abs((-band.positions[:, 1] - 1.26) / 0.08) * 0.9
        colour = np.where((diamond < 0.75)[:, None], LIMESTONE * 1.2, TILE_BLUE * 1.4)
        parts += [wall, band.painted(stone(band.positions, colour, rng, contrast=0.1), gloss=0.4)]
        parts.append(grain(wall, 0.5 * detail, 0.012, rng, height=0.03))
        # above the ceiling, where it shows from outside only
        loft = strip(high, layout.RIDGE - 0.3, 0.3)
        parts.append(loft.painted(PLASTER * 0.8))
    return join(*parts)


def doors(rng: np.random.Generator) -> Surfels:
    """Arched doors of planks in frames of stone, in every other bay of the back walls."""
    half, spring, ring = 0.62, 2.1, 0.17
    planks = rectangle((-half, -spring - half, 0.03), (2 * half, 0, 0), (0, spring + half, 0), 0.0775, rng, jitter=0.0)
    x, height = planks.positions[:, 0], -planks.positions[:, 1]
    planks = planks.where((height < spring) | (x**2 + (height - spring) ** 2 < half**2))
    x, height = planks.positions[:, 0], -planks.positions[:, 1]
    board = np.floor((x + half) / 0.155)
    tint = 1.6 + 0.5 * np.sin(board * 7.7) - 0.7 * (np.abs((x + half) / 0.155 % 1 - 0.5) > 0.4)
    tint += rng.normal(size=len(planks)) * 0.1
    iron = (np.abs(height - 0.5) < 0.05) | (np.abs(height - 1.8) < 0.05)
    colour = np.where(iron[:, None], np.array(IRON), WOOD * tint[:, None])
    leaf = facing(planks, np.array([0, 0, 1])).painted(colour)

    def moulding(u: Floats, v: Floats) -> tuple[Any, Any, Any]:
        # up one jamb, round the arch and down the other, by length
        length = 2 * spring + np.pi * half
        s = u * length
        angle = ((s - spring) / half).clip(0, np.pi)
        r = half + ring * v
        rise = np.where(s < spring, s, np.where(s > length - spring, length - s, spring))
        return np.cos(angle) * r, -(rise + np.sin(angle) * r), 0.14 + 0 * u

    frame = facing(surface(moulding, 90, 2, rng, jitter=0.1, overlap=0.65), np.array([0, 0, 1]))
    stones = np.floor((np.arange(len(frame)) // 2) / 5).astype(np.int64) % 2
    colour = LIMESTONE * np.where(stones, 0.85, 1.1)[:, None]
    door = join(leaf, frame.painted(stone(frame.positions, colour, rng, contrast=0.06)))
    places, turns = [], []
    for side in (-1, 1):
        for x_ in layout.bay_centres(layout.BAYS_X)[1::2]:
            places.append((x_, -0.14, side * layout.OUTER_Z))
            turns.append(0.0 if side < 0 else np.pi)
        for z_ in layout.bay_centres(layout.BAYS_Z)[::2]:
            places.append((side * layout.OUTER_X, -0.14, z_))
            turns.append(-np.pi / 2 * side)
    return scatter(door, np.array(places), np.array(turns))


def ceiling(detail: float, rng: np.random.Generator) -> Surfels:
    """Dark boards over the gallery, and a beam over every column and bay."""
    x, z, ox, oz = layout.COURT_X, layout.COURT_Z, layout.OUTER_X, layout.OUTER_Z
    y = -layout.CEILING
    parts = []
    for x0, x1, z0, z1, across in (
        (-ox, ox, -oz, -z, True),
        (-ox, ox, z, oz, True),
        (-ox, -x, -z, z, False),
        (x, ox, -z, z, False),
    ):
        boards = rectangle((x0, y, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), 0.3 / detail, rng)
        run = boards.positions[:, 2] if across else boards.positions[:, 0]
        tint = 1.5 + 0.35 * np.sin(np.floor(run / 0.3) * 12.7)
        parts.append(facing(boards, np.array([0, 1, 0])).painted((WOOD * tint[:, None]).astype(np.float32)))
        if detail < 0.7:
            continue
        starts = np.arange(x0 if across else z0, x1 if across else z1, layout.BAY / 2) + 0.1
        for s in starts:
            corner = (s, y, z0) if across else (x0, y, s)
            beam = box(corner, (0.16, 0.2, z1 - z0) if across else (x1 - x0, 0.2, 0.16), 0.16, rng, bottom=True)
            beam = beam.where(beam.positions[:, 1] > y + 0.01)
            parts.append(beam.painted(stone(beam.positions, WOOD, rng, contrast=0.15)))
    return join(*parts)


def benches(rng: np.random.Generator) -> Surfels:
    """Stone benches against the gallery's long walls, between the doors."""
    parts = []
    for side in (-1, 1):
        for z in layout.bay_centres(layout.BAYS_Z)[1::4]:
            x = side * (layout.OUTER_X - 0.32)
            seat = box((x - 0.25, -0.62, z - 0.9), (0.5, 0.1, 1.8), 0.08, rng, bottom=True)
            feet = [box((x - 0.2, -0.52, z + at - 0.1), (0.4, 0.38, 0.2), 0.09, rng) for at in (-0.65, 0.65)]
            bench = join(seat, *feet)
            parts.append(bench.painted(stone(bench.positions, LIMESTONE, rng), gloss=0.4))
    return join(*parts)


def lanterns(rng: np.random.Generator) -> Surfels:
    """Iron lanterns on chains, each with a flame and a soft halo."""
    cap = turned([(0.16, 0.2), (0.1, 0.26), (0.02, 0.34)], 12, 0.05, rng).painted(IRON)
    foot = turned([(0.04, -0.22), (0.12, -0.18), (0.12, -0.15)], 10, 0.05, rng).painted(IRON)
    glass = turned([(0.1, -0.14), (0.13, 0.19)], 10, 0.08, rng).painted((0.9, 0.6, 0.3), opacity=0.45)
    glass = glass.glowing((1.5, 0.8, 0.28))
    chain = flat(
        np.stack((np.zeros(6), -np.linspace(0.42, 1.25, 6), np.zeros(6)), 1),
        np.broadcast_to(np.eye(3), (6, 3, 3)),
        np.broadcast_to([0.008, 0.09, 0.008], (6, 3)),
    ).painted(IRON)
    core = blobs(np.zeros((3, 3), np.float32), 0.06, rng).painted((0, 0, 0), opacity=0.95).glowing((9.0, 6.2, 3.0))
    halo = blobs(np.zeros((2, 3), np.float32), np.array([0.2, 0.42]), rng).painted((0, 0, 0), opacity=0.16)
    halo = replace(halo.glowing((3.0, 1.7, 0.7)), opacity=np.array([0.3, 0.12], np.float32))
    lamp = join(cap, foot, glass, chain, core, halo)
    return join(*(lamp.moved(*map(float, place)) for place in layout.lamp_places()))
