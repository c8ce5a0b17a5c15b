"""What the courtyard is made of: colours in linear RGB, and the weathering of stone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tigas_render.scenes.demo.surfels import Floats, Surfels, flat, noise

LIMESTONE = np.array([0.56, 0.50, 0.41], np.float32)
PLASTER = np.array([0.74, 0.56, 0.38], np.float32)
OCHRE = np.array([0.60, 0.36, 0.19], np.float32)
TERRACOTTA = np.array([0.50, 0.22, 0.115], np.float32)
WOOD = np.array([0.16, 0.092, 0.052], np.float32)
TILE_BLUE = np.array([0.05, 0.17, 0.27], np.float32)
LEAF = np.array([0.062, 0.11, 0.022], np.float32)
OLIVE = np.array([0.10, 0.125, 0.06], np.float32)
BARK = np.array([0.11, 0.08, 0.055], np.float32)
IRON = (0.03, 0.028, 0.03)


def stone(points: Floats, colour: Floats, rng: np.random.Generator, *, contrast: float = 0.08) -> Floats:
    """Linear RGB [N, 3] of weathered stone or plaster: large stains and fine grain."""
    stain = noise(points, 3.0, rng) * contrast + noise(points, 0.5, rng) * contrast * 0.5
    grain = rng.normal(size=len(points)).astype(np.float32) * contrast * 0.45
    weathered: Floats = (colour * (1 + stain + grain)[:, None]).clip(0.01, 0.95)
    return weathered


def level(positions: Floats, size: Floats) -> Surfels:
    """Flat, level surfels facing up; `size` [N, 2] are the standard deviations along x and z."""
    frame = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float32)
    sizes = np.concatenate((size, np.full((len(size), 1), 0.003)), axis=1)
    return flat(positions, np.broadcast_to(frame, (len(positions), 3, 3)), sizes)


def grain(surfels: Surfels, share: float, size: float, rng: np.random.Generator, *, height: float = 0.015) -> Surfels:
    """Fine marks over a surface, pits and pale spots, which keep it sharp when one steps up to it.

    `share` is how many marks there are to a surfel; `size` their standard deviation and `height` their distance
    in front of it, in metres: the coarser the surface, the farther must they be to be drawn in front of it.
    """
    n = round(len(surfels) * share)
    chosen = rng.integers(0, len(surfels), n)
    part = surfels.where(chosen)
    spread = rng.normal(size=(n, 2, 1)) * part.sizes[:, :2, None]
    places = part.positions + (part.frames[:, :2] * spread).sum(1) + height * part.normals
    wide = size * rng.lognormal(0, 0.5, (n, 1))
    sizes = np.concatenate((wide * rng.uniform(0.5, 2.0, (n, 1)), wide, np.full((n, 1), 0.002)), axis=1)
    tint = np.where(rng.uniform(size=(n, 1)) < 0.6, rng.uniform(0.5, 0.8, (n, 1)), rng.uniform(1.1, 1.35, (n, 1)))
    marks = flat(places, part.frames, sizes).painted(part.albedo * tint, opacity=0.5)
    return replace(marks, gloss=part.gloss)
