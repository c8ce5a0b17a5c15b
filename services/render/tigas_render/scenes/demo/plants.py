"""What grows in the courtyard and behind its walls."""

from __future__ import annotations

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.materials import BARK, LEAF, OLIVE, TERRACOTTA, stone
from tigas_render.scenes.demo.surfels import Floats, Surfels, blobs, facing, join, noise, turned, unit


def plants(detail: float, rng: np.random.Generator) -> Surfels:
    """Trees in pots and beds, lavender, climbers, and cypresses outside."""
    parts = [climbers(detail, rng), lavender(detail, rng), cypresses(detail, rng)]
    for x, z in layout.POTS:
        parts.append(orange_tree(detail, rng).moved(x, 0, z))
    for tree_x, tree_z, height, radius in layout.TREES:
        parts.append(olive_tree(height, radius, detail, rng).moved(tree_x, 0, tree_z))
    return join(*parts)


def _crown(n: int, radius: float, size: float, colour: Floats, rng: np.random.Generator) -> Surfels:
    """Leaf clusters in a ball, denser towards its surface; lighter outside than in the crown's depth."""
    direction = unit(rng.normal(size=(n, 3)))
    depth = rng.uniform(size=n) ** 0.35
    bumps = 1 + 0.16 * noise(direction.astype(np.float32), 0.9, rng)
    positions = direction * (radius * depth * bumps)[:, None] * np.array([1, 0.9, 1])
    leaves = blobs(positions.astype(np.float32), size * rng.uniform(0.7, 1.3, n), rng, flatness=0.25)
    tint = (0.35 + 0.75 * depth**2) * (1 + 0.25 * rng.normal(size=n))
    hue = 1 + np.array([0.25, 0.05, -0.2]) * rng.normal(size=(n, 1)) * 0.5
    return leaves.painted((colour * tint[:, None] * hue).clip(0.01, 0.6).astype(np.float32), opacity=0.9, wrap=1.0)


def orange_tree(detail: float, rng: np.random.Generator) -> Surfels:
    """A clipped orange tree in a terracotta pot."""
    pot = turned(
        [(0.2, 0.0), (0.29, 0.44), (0.33, 0.45), (0.33, 0.53), (0.29, 0.53), (0.27, 0.49), (0.02, 0.49)],
        round(26 * detail),
        0.05 / detail,
        rng,
    )
    trunk = turned([(0.04, 0.45), (0.03, 1.4)], round(7 * detail) + 1, 0.08 / detail, rng)
    height, radius = layout.POT_CROWN
    crown = _crown(round(1500 * detail**2), radius, 0.032 / detail, LEAF, rng).moved(0, -height, 0)
    fruit = unit(rng.normal(size=(26, 3))) * radius * np.array([0.93, 0.84, 0.93])
    oranges = blobs(fruit, 0.03, rng).moved(0, -height, 0).painted((0.5, 0.13, 0.01), wrap=0.6)
    return join(pot.painted(stone(pot.positions, TERRACOTTA * 1.2, rng)), trunk.painted(tuple(BARK)), crown, oranges)


def olive_tree(height: float, radius: float, detail: float, rng: np.random.Generator) -> Surfels:
    """An old olive tree in a ring of stone: a bent trunk, boughs, and a loose crown of several clusters."""
    parts = []
    ends = [np.array([0, -height + 0.2, 0])]
    for k in range(7):
        turn = 2 * np.pi * k / 7 + rng.uniform(-0.3, 0.3)
        reach = radius * rng.uniform(0.45, 0.7)
        ends.append(np.array([np.cos(turn) * reach, -height + rng.uniform(-0.5, 0.4), np.sin(turn) * reach]))
    fork = np.array([0.12, -height * 0.45, 0.05])
    for start, end, thick in [(np.zeros(3), fork, 0.17), *((fork, end, 0.07) for end in ends)]:
        t = np.linspace(0, 1, max(5, round(16 * detail)))[:, None]
        spine = start + (end - start) * t + 0.06 * np.sin(5 * t + end.sum()) * np.array([1, 0, 1])
        turns = rng.uniform(0, 2 * np.pi, (len(t), 6))
        width = thick * (1.15 - 0.5 * t)
        around = np.stack((np.cos(turns), 0 * turns, np.sin(turns)), -1)
        places = (spine[:, None] + around * width[:, :, None]).reshape(-1, 3)
        bark = blobs(places.astype(np.float32), 0.07 * thick / 0.12 + 0.02, rng, flatness=0.4)
        outward = around.reshape(-1, 3).astype(np.float32)
        parts.append(facing(bark, outward).painted(stone(places.astype(np.float32), BARK, rng, contrast=0.2)))
    per_cluster = round(520 * detail**2 * radius)
    for end in ends:
        cluster = _crown(per_cluster, radius * 0.52, 0.042 / detail, OLIVE, rng)
        parts.append(cluster.moved(*map(float, end)))
    bed = turned(
        [(0.85, 0.0), (0.85, 0.32), (0.65, 0.34), (0.63, 0.25), (0.02, 0.25)], round(50 * detail), 0.08 / detail, rng
    )
    radius_at = np.hypot(bed.positions[:, 0], bed.positions[:, 2])[:, None]
    soil = np.where(radius_at < 0.62, np.array([0.09, 0.07, 0.045]), np.array([0.56, 0.50, 0.41]))
    parts.append(bed.painted(stone(bed.positions, soil.astype(np.float32), rng)))
    return join(*parts)


def lavender(detail: float, rng: np.random.Generator) -> Surfels:
    """Lavender along the basin's long sides."""
    n = round(4200 * detail**2)
    side = rng.choice([-1.0, 1.0], n)
    z = rng.uniform(-5.4, 5.4, n)
    height = rng.uniform(0.02, 0.55, n)
    x = side * (layout.BASIN_X + layout.RIM + 0.3 + rng.normal(size=n) * 0.11 * (1.25 - height))
    clump = 0.75 + 0.25 * np.sin(z * 7.3 + side)
    places = np.stack((x, -height * clump, z), 1).astype(np.float32)
    stalks = blobs(places, 0.035 / detail, rng, flatness=0.35)
    bloom = (height > 0.36)[:, None]
    purple = np.array([0.15, 0.095, 0.30]) * rng.uniform(0.7, 1.4, (n, 1))
    green = np.array([0.09, 0.13, 0.055]) * rng.uniform(0.6, 1.3, (n, 1)) * (0.45 + height[:, None])
    return stalks.painted(np.where(bloom, purple, green).astype(np.float32), opacity=0.88, wrap=1.0)


def climbers(detail: float, rng: np.random.Generator) -> Surfels:
    """Bougainvillea up a few columns and along the wall above them."""
    parts = []
    for x, z, run in ((layout.COURT_X, -1.2, 5.0), (-layout.COURT_X, 6.0, 3.6), (4 * 1.0 + 0.8, layout.COURT_Z, 4.2)):
        n = round(2300 * detail**2)
        t = rng.uniform(size=n)
        on_shaft = t < 0.3
        height = np.where(on_shaft, rng.uniform(0.3, 3.0, n), 4.35 + rng.normal(size=n) * 0.32)
        along = np.where(on_shaft, rng.normal(size=n) * 0.16, (rng.beta(1.6, 1.6, n) - 0.5) * run)
        height -= np.where(on_shaft, 0, 0.35 * np.abs(noise(along[:, None].astype(np.float32), 1.4, rng)))
        out = np.abs(rng.normal(size=n)) * 0.13 + np.where(on_shaft, 0.15, layout.WALL_DEPTH / 2 + 0.03)
        inward = -np.sign(x) if abs(x) == layout.COURT_X else 0.0
        if inward:
            places = np.stack((x + inward * out, -height, z + along), 1)
        else:
            places = np.stack((x + along, -height, z - out), 1)
        leaves = blobs(places.astype(np.float32), 0.04 / detail * rng.uniform(0.7, 1.3, n), rng, flatness=0.3)
        flower = (noise(places.astype(np.float32), 0.6, rng) + 0.6 * rng.normal(size=n) > 0.1)[:, None]
        magenta = np.array([0.36, 0.035, 0.15]) * rng.uniform(0.6, 1.35, (n, 1))
        green = LEAF * rng.uniform(0.6, 1.4, (n, 1))
        parts.append(leaves.painted(np.where(flower, magenta, green).astype(np.float32), opacity=0.9, wrap=1.0))
    return join(*parts)


def cypresses(detail: float, rng: np.random.Generator) -> Surfels:
    """Dark spires behind the walls."""
    parts = []
    for x, z, high in (
        (-9.5, 19.0, 11.5),
        (-7.6, 21.5, 13.0),
        (-4.8, 20.0, 10.0),
        (1.2, 22.0, 11.5),
        (3.0, 24.0, 9.5),
        (-18.0, 6.0, 12.0),
        (-19.0, -4.0, 10.5),
        (18.5, 3.0, 12.5),
        (19.0, -8.0, 11.0),
        (-3.0, -21.0, 12.0),
        (6.0, -22.0, 11.0),
    ):
        n = round(400 * detail**2)
        t = rng.uniform(size=n)
        wide = 1.0 * np.sin(np.pi * (0.08 + 0.92 * t) ** 0.7).clip(0.05) * rng.uniform(0.75, 1.05, n)
        turn = rng.uniform(0, 2 * np.pi, n)
        places = np.stack((x + np.cos(turn) * wide, -2.0 - t * (high - 2.0), z + np.sin(turn) * wide), 1).astype(
            np.float32
        )
        outward = np.stack((np.cos(turn), 0 * turn, np.sin(turn)), 1).astype(np.float32)
        spire = facing(blobs(places, 0.22 / detail, rng, flatness=0.45), outward)
        tint = rng.uniform(0.5, 1.3, (n, 1))
        parts.append(spire.painted((np.array([0.034, 0.058, 0.024]) * tint).astype(np.float32), wrap=1.0))
    return join(*parts)
