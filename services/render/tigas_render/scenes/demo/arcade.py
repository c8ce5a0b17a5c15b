"""The arcades around the court: columns, arches, and the wall over them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.materials import LIMESTONE, OCHRE, PLASTER, TILE_BLUE, stone
from tigas_render.scenes.demo.surfels import (
    Floats,
    Surfels,
    box,
    facing,
    join,
    noise,
    rectangle,
    scatter,
    surface,
    turned,
)


def arcade(detail: float, rng: np.random.Generator) -> Surfels:
    """Columns and arches on all four sides."""
    return join(columns(detail, rng), arcades(detail, rng))


def columns(detail: float, rng: np.random.Generator) -> Surfels:
    """One column, moulded once and set in every place."""
    r = layout.COLUMN_RADIUS
    around = max(8, round(17 * detail))
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

        fine = detail if face > 0 else 0.7 * detail
        wall = surface(spandrel, round(20 * fine), round(11 * fine), rng, overlap=0.85)
        parts.append(facing(wall, np.array([0, 0, face])).painted(stone(wall.positions, PLASTER, rng, contrast=0.05)))
        stones = surface(voussoirs, round(45 * fine), max(2, round(4 * fine)), rng, jitter=0.1)
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
