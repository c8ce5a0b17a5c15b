"""The courtyard's stone: floor, arcades, columns, walls, ceiling, roofs, tower, and the basin with its fountain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.surfels import (
    Floats,
    Point,
    Surfels,
    box,
    facing,
    flat,
    join,
    noise,
    rectangle,
    scatter,
    strokes,
    surface,
    turned,
)

LIMESTONE = np.array([0.56, 0.50, 0.41], np.float32)
PLASTER = np.array([0.74, 0.56, 0.38], np.float32)
OCHRE = np.array([0.60, 0.36, 0.19], np.float32)
TERRACOTTA = np.array([0.50, 0.22, 0.115], np.float32)
WOOD = np.array([0.16, 0.092, 0.052], np.float32)
TILE_BLUE = np.array([0.05, 0.17, 0.27], np.float32)


def architecture(detail: float, rng: np.random.Generator) -> Surfels:
    """Everything built, except the water; `detail` 1 is full resolution, 0.5 has a quarter of the surfels."""
    return join(
        court_floor(detail, rng),
        gallery_floor(detail, rng),
        columns(detail, rng),
        arcades(detail, rng),
        outer_walls(detail, rng),
        ceiling(detail, rng),
        roofs(detail, rng),
        tower(detail, rng),
        basin(detail, rng),
        fountain(detail, rng),
    )


def stone(points: Floats, colour: Floats, rng: np.random.Generator, *, contrast: float = 0.08) -> Floats:
    """Linear RGB [N, 3] of weathered stone or plaster: large stains and fine grain."""
    stain = noise(points, 3.0, rng) * contrast + noise(points, 0.5, rng) * contrast * 0.5
    grain = rng.normal(size=len(points)).astype(np.float32) * contrast * 0.45
    weathered: Floats = (colour * (1 + stain + grain)[:, None]).clip(0.01, 0.95)
    return weathered


def _paving(
    x0: float, x1: float, z0: float, z1: float, y: float, slab: float, detail: float, rng: np.random.Generator
) -> list[Surfels]:
    """Slabs, each with a tint of its own, and the dark joints between them."""
    spacing = 0.15 / detail
    slabs = rectangle((x0, y, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), spacing, rng, jitter=0.3)
    cell = np.floor(_ground(slabs) / slab).astype(np.int64)
    tint = np.sin(cell @ np.array([12.9898, 78.233]) * 43.7) * 0.5 + np.sin(cell @ np.array([3.7, 9.1]) * 17.3) * 0.5
    colour = stone(slabs.positions, LIMESTONE, rng, contrast=0.06) * (1 + 0.13 * tint)[:, None].astype(np.float32)
    warm = (np.sin(cell @ np.array([7.3, 5.9]) * 29.1) > 0.6)[:, None]
    colour = np.where(warm, colour * np.array([1.04, 0.93, 0.82], np.float32), colour)
    parts = [slabs.painted(colour.astype(np.float32), gloss=0.75)]
    if detail > 0.7:
        parts += [_joints(x0, x1, z0, z1, y - 0.006, slab)]
    return parts


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


def _ground(surfels: Surfels) -> Floats:
    """[N, 2] ground coordinates."""
    return surfels.positions[:, [0, 2]]


def court_floor(detail: float, rng: np.random.Generator) -> Surfels:
    """The paving between the colonnades, around the basin."""
    x, z = layout.COURT_X - 0.3, layout.COURT_Z - 0.3
    bx, bz = layout.BASIN_X + layout.RIM, layout.BASIN_Z + layout.RIM
    parts = []
    for x0, x1, z0, z1 in ((-x, x, -z, -bz), (-x, x, bz, z), (-x, -bx, -bz, bz), (bx, x, -bz, bz)):
        parts += _paving(x0, x1, z0, z1, 0.0, 0.8, detail, rng)
    return join(*parts)


def gallery_floor(detail: float, rng: np.random.Generator) -> Surfels:
    """One step up: darker tiles in the gallery, with a kerb of limestone under the columns."""
    step = -0.14
    x, z, ox, oz = layout.COURT_X - 0.3, layout.COURT_Z - 0.3, layout.OUTER_X, layout.OUTER_Z
    tiles = []
    for x0, x1, z0, z1 in ((-ox, ox, -oz, -z), (-ox, ox, z, oz), (-ox, -x, -z, z), (x, ox, -z, z)):
        part = rectangle((x0, step, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), 0.16 / detail, rng)
        odd = (np.floor(_ground(part) / 0.5).astype(np.int64).sum(1) % 2).astype(np.float32)[:, None]
        colour = (
            stone(part.positions, LIMESTONE * 0.85, rng) * (1 - odd) + stone(part.positions, OCHRE * 0.75, rng) * odd
        )
        kerb = np.maximum(np.abs(part.positions[:, 0]) / (x + 0.6), np.abs(part.positions[:, 2]) / (z + 0.6)) < 1
        tiles.append(part.painted(np.where(kerb[:, None], LIMESTONE * 1.05, colour).astype(np.float32), gloss=0.8))
    edges = [
        ((-x, step, -z), (2 * x, 0, 0), (0, -step, 0), (0, 0, 1)),
        ((-x, step, z), (2 * x, 0, 0), (0, -step, 0), (0, 0, -1)),
        ((-x, step, -z), (0, 0, 2 * z), (0, -step, 0), (1, 0, 0)),
        ((x, step, -z), (0, 0, 2 * z), (0, -step, 0), (-1, 0, 0)),
    ]
    for corner, along, down, normal in edges:
        edge = rectangle(corner, along, down, 0.07 / detail, rng)
        tiles.append(facing(edge, np.asarray(normal, np.float32)).painted(stone(edge.positions, LIMESTONE, rng)))
    return join(*tiles)


def columns(detail: float, rng: np.random.Generator) -> Surfels:
    """One column, moulded once and set in every place."""
    r = layout.COLUMN_RADIUS
    around = max(9, round(20 * detail))
    base = turned(
        [(r * 1.75, 0.14), (r * 1.75, 0.22), (r * 1.5, 0.25), (r * 1.62, 0.3), (r * 1.3, 0.36), (r * 1.05, 0.42)],
        around,
        0.045 / detail,
        rng,
        jitter=0.1,
    )
    shaft = turned([(r * 1.05, 0.4), (r, 1.2), (r * 0.9, 2.3)], around, 0.14 / detail, rng, jitter=0.15)
    capital = turned(
        [(r * 0.98, 2.28), (r * 1.1, 2.32), (r * 0.95, 2.35), (r * 1.15, 2.46), (r * 1.75, 2.6), (r * 1.45, 2.6)],
        around,
        0.04 / detail,
        rng,
        jitter=0.1,
    )
    a = r * 1.6
    abacus = box((-a, -2.76, -a), (2 * a, 0.17, 2 * a), 0.07 / detail, rng, bottom=True)
    plinth = box((-a * 1.15, -0.2, -a * 1.15), (2.3 * a, 0.1, 2.3 * a), 0.08 / detail, rng)
    parts = [
        piece.painted(stone(piece.positions, LIMESTONE * shadeless, rng, contrast=0.06), gloss=0.35)
        for piece, shadeless in ((base, 1.0), (shaft, 1.12), (capital, 1.08), (abacus, 1.0), (plinth, 0.95))
    ]
    return scatter(join(*parts), *_with_turns(layout.column_places()))


def _with_turns(places: Floats) -> tuple[Floats, Floats]:
    return places, np.zeros(len(places), np.float32)


def arcades(detail: float, rng: np.random.Generator) -> Surfels:
    """The walls over the columns: one bay for each kind of side, repeated along it."""
    bay = _bay(detail, rng)
    places, turns = [], []
    for side in (-1, 1):
        for x in layout.bay_centres(layout.BAYS_X):
            places.append((x, 0, side * layout.COURT_Z))
            turns.append(0.0 if side < 0 else np.pi)
        for z in layout.bay_centres(layout.BAYS_Z):
            places.append((side * layout.COURT_X, 0, z))
            turns.append(-np.pi / 2 * side)
    wall = scatter(bay, np.array(places, np.float32), np.array(turns, np.float32))
    tinted = wall.albedo * (1 + 0.06 * noise(wall.positions, 2.5, rng))[:, None]
    # rain leaves the wall darker below its cornice and near the springing of the arches
    streak = np.exp((wall.positions[:, 1] + layout.EAVES) / -0.35).clip(0, 1)[:, None] * 0.22
    return replace(wall, albedo=(tinted * (1 - streak)).astype(np.float32))


def _bay(detail: float, rng: np.random.Generator) -> Surfels:
    """One bay of wall along x, its court side facing +z, centred over the arch at the column's axis z = 0."""
    half, r, deep = layout.BAY / 2, layout.ARCH_RADIUS, layout.WALL_DEPTH / 2
    spring, top, ring = layout.SPRING, layout.EAVES, 0.24
    parts = []
    for face in (1, -1):

        def spandrel(u: Floats, v: Floats, z: float = face * deep) -> tuple[Any, Any, Any]:
            # from the arch's ring (v = 0) to the top of the wall (v = 1), for each x
            x = (2 * u - 1) * half
            inner = np.sqrt(np.maximum((r + ring) ** 2 - x**2, 0))
            return x, -(spring + inner + v * (top - spring - inner)), z

        def voussoirs(u: Floats, v: Floats, z: float = face * (deep + 0.025)) -> tuple[Any, Any, Any]:
            angle = np.pi * u
            return np.cos(angle) * (r + ring * v), -(spring + np.sin(angle) * (r + ring * v)), z

        wall = surface(spandrel, round(20 * detail), round(11 * detail), rng, overlap=0.85)
        parts.append(facing(wall, np.array([0, 0, face])).painted(stone(wall.positions, PLASTER, rng, contrast=0.05)))
        stones = surface(voussoirs, round(45 * detail), max(2, round(4 * detail)), rng, jitter=0.1)
        angle = np.arctan2(-stones.positions[:, 1] - spring, stones.positions[:, 0])
        odd = (np.floor(angle / np.pi * 15).astype(np.int64) % 2)[:, None]
        colour = np.where(odd, LIMESTONE * 1.15, OCHRE * 0.8).astype(np.float32)
        parts.append(
            facing(stones, np.array([0, 0, face])).painted(stone(stones.positions, colour, rng, contrast=0.05))
        )
    intrados = surface(
        lambda u, v: (np.cos(np.pi * u) * r, -(spring + np.sin(np.pi * u) * r), (2 * v - 1) * (deep + 0.02)),
        round(34 * detail),
        round(5 * detail) + 1,
        rng,
    )
    to_axis = np.stack(
        (-intrados.positions[:, 0], -(intrados.positions[:, 1] + spring), 0 * intrados.positions[:, 0]), 1
    )
    intrados = facing(intrados, to_axis)
    parts.append(intrados.painted(stone(intrados.positions, LIMESTONE, rng, contrast=0.05)))
    # two mouldings and a band of blue tiles run along the court side
    for height, out, tall, colour in (
        (top, 0.16, 0.16, LIMESTONE * 1.1),
        (top - 0.5, 0.05, 0.06, LIMESTONE),
        (top - 0.3, 0.015, 0.22, TILE_BLUE),
    ):
        band = rectangle(
            (-half, -height, deep + out), (layout.BAY, 0, 0), (0, tall, 0), 0.075 / detail, rng, jitter=0.1
        )
        lower = rectangle((-half, -height + tall, deep), (layout.BAY, 0, 0), (0, 0, out), 0.08 / detail, rng)
        colours = stone(band.positions, colour, rng, contrast=0.1)
        if colour is TILE_BLUE:
            diamond = np.abs((band.positions[:, 0] / 0.3) % 1 - 0.5) + np.abs(
                (band.positions[:, 1] + height) / 0.22 - 0.5
            )
            colours = np.where((diamond < 0.3)[:, None], LIMESTONE * 1.3, colours).astype(np.float32)
        parts.append(facing(band, np.array([0, 0, 1])).painted(colours, gloss=0.5 * (colour is TILE_BLUE)))
        parts.append(facing(lower, np.array([0, 1, 0])).painted(stone(lower.positions, LIMESTONE, rng)))
    return join(*parts)


def outer_walls(detail: float, rng: np.random.Generator) -> Surfels:
    """The gallery's back walls: ochre wainscot, warm plaster, and doors of dark wood in some bays."""
    x, z, high = layout.OUTER_X, layout.OUTER_Z, layout.CEILING + 0.3
    sides: list[tuple[Point, Point, Point, int]] = [
        ((-x, -high, -z), (2 * x, 0, 0), (0, 0, 1), 1),
        ((-x, -high, z), (2 * x, 0, 0), (0, 0, -1), -1),
        ((-x, -high, -z), (0, 0, 2 * z), (1, 0, 0), 1),
        ((x, -high, -z), (0, 0, 2 * z), (-1, 0, 0), -1),
    ]
    parts = []
    for corner, along, normal, _ in sides:
        wall = rectangle(corner, along, (0, high, 0), 0.16 / detail, rng)
        wall = facing(wall, np.asarray(normal, np.float32))
        height = -wall.positions[:, 1]
        run = wall.positions[:, 0] if along[0] else wall.positions[:, 2]
        colour = stone(wall.positions, PLASTER, rng, contrast=0.07)
        colour = np.where((height < 1.25)[:, None], stone(wall.positions, OCHRE, rng, contrast=0.07), colour)
        colour = np.where(((height > 1.2) & (height < 1.32))[:, None], TILE_BLUE * 1.3, colour)
        offset = np.abs((run / (2 * layout.BAY) + 0.25) % 1 - 0.5) * 2 * layout.BAY
        arch = (offset < 0.62) & (height < 2.1) | (offset**2 + (height - 2.1) ** 2 < 0.62**2) & (height >= 2.1)
        frame = (offset < 0.8) & (height < 2.1) | (offset**2 + (height - 2.1) ** 2 < 0.8**2) & (height >= 2.1)
        colour = np.where(frame[:, None], LIMESTONE, colour)
        plank = 0.8 + 0.35 * (np.floor(run / 0.16) % 2)
        colour = np.where(arch[:, None], WOOD * plank[:, None], colour)
        parts.append(wall.painted(colour.astype(np.float32)))
        if detail > 0.7:
            outside = rectangle(corner, along, (0, high, 0), 0.5, rng)
            outside = facing(outside.moved(*(-0.3 * n for n in normal)), -np.asarray(normal, np.float32))
            parts.append(outside.painted(tuple(PLASTER)))
    return join(*parts)


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
        boards = rectangle((x0, y, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), 0.24 / detail, rng)
        run = boards.positions[:, 2] if across else boards.positions[:, 0]
        tint = 1.5 + 0.35 * np.sin(np.floor(run / 0.24) * 12.7)
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
    body = box((x - half, -high, z - half), (2 * half, high, 2 * half), 0.22 / detail, rng)
    near = np.stack((np.abs(body.positions[:, 0] - x), np.abs(body.positions[:, 2] - z)), 1).min(1)
    height = -body.positions[:, 1]
    offset = np.abs(near - 0.95)
    belfry = (offset < 0.55) & (height > high - 3.1) & (height < high - 1.6)
    belfry |= (offset**2 + (height - high + 1.6) ** 2 < 0.55**2) & (height >= high - 1.6)
    window = (near < 0.3) & (height > 7.0) & (height < 8.3)
    colour = stone(body.positions, PLASTER * 0.95, rng, contrast=0.09)
    corner = np.stack((np.abs(body.positions[:, 0] - x), np.abs(body.positions[:, 2] - z)), 1).min(1) > half - 0.35
    colour = np.where(corner[:, None], LIMESTONE, colour)
    colour = np.where((belfry | window)[:, None], np.array([0.03, 0.027, 0.03], np.float32), colour)
    band = (np.abs(height - high + 3.5) < 0.15) | (height > high - 0.3)
    colour = np.where(band[:, None], LIMESTONE * 1.1, colour)
    parts = [body.where(height > 4.5).painted(colour[height > 4.5].astype(np.float32))]
    for k in range(4):

        def face(u: Floats, v: Floats) -> tuple[Any, Any, Any]:
            r = (half + 0.3) * (1 - v)
            return (2 * u - 1) * r, -(high + 2.3 * v), r + 0 * u

        side = facing(surface(face, round(26 * detail), round(16 * detail), rng), np.array([0, -1, 1]))
        tint = 1 + 0.2 * rng.normal(size=len(side))
        side = side.painted((TERRACOTTA * tint[:, None]).clip(0.02, 0.9).astype(np.float32))
        parts.append(side.moved(x, 0, z, turn=k * np.pi / 2))
    return join(*parts)


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
        parts.append(coping.painted(stone(coping.positions, LIMESTONE * 1.2, rng, contrast=0.05), gloss=0.7))
    for inside, hx, hz in ((True, x, z), (False, x + rim, z + rim)):
        for corner, along, normal in (
            ((-hx, -high, -hz), (2 * hx, 0, 0), (0, 0, -1)),
            ((-hx, -high, hz), (2 * hx, 0, 0), (0, 0, 1)),
            ((-hx, -high, -hz), (0, 0, 2 * hz), (-1, 0, 0)),
            ((hx, -high, -hz), (0, 0, 2 * hz), (1, 0, 0)),
        ):
            down = high - layout.WATER + 0.06 if inside else high
            side = rectangle(corner, along, (0, down, 0), 0.07 / detail, rng, jitter=0.1)
            side = facing(side, np.asarray(normal, np.float32) * (-1 if inside else 1))
            run = side.positions[:, 0] if along[0] else side.positions[:, 2]
            tile = (np.floor(run / 0.14) + np.floor(side.positions[:, 1] / 0.14)).astype(np.int64) % 2
            colour = np.where(tile[:, None], TILE_BLUE * 1.5, LIMESTONE * 1.1).astype(np.float32)
            lip = (side.positions[:, 1] < -high + 0.1)[:, None]
            colour = np.where(lip, LIMESTONE * 1.2, colour)
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


def level(positions: Floats, size: Floats) -> Surfels:
    """Flat, level surfels facing up; `size` [N, 2] are the standard deviations along x and z."""
    frame = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float32)
    sizes = np.concatenate((size, np.full((len(size), 1), 0.003)), axis=1)
    return flat(positions, np.broadcast_to(frame, (len(positions), 3, 3)), sizes)
