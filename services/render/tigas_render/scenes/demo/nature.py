"""What grows, flows and shines in the courtyard, and the landscape and sky around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.architecture import TERRACOTTA, level, stone
from tigas_render.scenes.demo.layout import SUN
from tigas_render.scenes.demo.surfels import Floats, Surfels, blobs, box, facing, flat, join, noise, turned, unit

LEAF = np.array([0.105, 0.17, 0.035], np.float32)
OLIVE = np.array([0.17, 0.2, 0.085], np.float32)
BARK = np.array([0.14, 0.1, 0.07], np.float32)
IRON = (0.03, 0.028, 0.03)

SKY_RADIUS = 220.0


def nature(detail: float, rng: np.random.Generator) -> Surfels:
    """Trees in pots and beds, hedges, climbers, and the lanterns, all of them lit by the sun."""
    parts = [lanterns(detail, rng), climbers(detail, rng), hedges(detail, rng)]
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
    fruit = unit(rng.normal(size=(26, 3))).astype(np.float32) * radius * 0.98
    oranges = blobs(fruit, 0.03, rng).moved(0, -height, 0).painted((0.75, 0.24, 0.02), wrap=0.6)
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
    per_cluster = round(750 * detail**2 * radius)
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


def hedges(detail: float, rng: np.random.Generator) -> Surfels:
    """Lavender along the basin's long sides."""
    n = round(5200 * detail**2)
    side = rng.choice([-1.0, 1.0], n)
    z = rng.uniform(-5.4, 5.4, n)
    height = rng.uniform(0.02, 0.55, n)
    x = side * (layout.BASIN_X + layout.RIM + 0.3 + rng.normal(size=n) * 0.11 * (1.25 - height))
    clump = 0.75 + 0.25 * np.sin(z * 7.3 + side)
    places = np.stack((x, -height * clump, z), 1).astype(np.float32)
    stalks = blobs(places, 0.035 / detail, rng, flatness=0.35)
    bloom = (height > 0.36)[:, None]
    purple = np.array([0.23, 0.14, 0.42]) * rng.uniform(0.7, 1.4, (n, 1))
    green = np.array([0.13, 0.18, 0.08]) * rng.uniform(0.6, 1.3, (n, 1)) * (0.45 + height[:, None])
    return stalks.painted(np.where(bloom, purple, green).astype(np.float32), opacity=0.88, wrap=1.0)


def climbers(detail: float, rng: np.random.Generator) -> Surfels:
    """Bougainvillea up a few columns and along the wall above them."""
    parts = []
    for x, z, run in ((layout.COURT_X, -1.2, 5.0), (-layout.COURT_X, 6.0, 3.6), (4 * 1.0 + 0.8, layout.COURT_Z, 4.2)):
        n = round(2600 * detail**2)
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
        magenta = np.array([0.52, 0.05, 0.22]) * rng.uniform(0.6, 1.35, (n, 1))
        green = LEAF * rng.uniform(0.6, 1.4, (n, 1))
        parts.append(leaves.painted(np.where(flower, magenta, green).astype(np.float32), opacity=0.9, wrap=1.0))
    return join(*parts)


def lanterns(detail: float, rng: np.random.Generator) -> Surfels:
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


def water(rng: np.random.Generator) -> tuple[Surfels, Floats, Floats]:
    """The basin's surface, thin enough to show what is mirrored below, with its colour and change by direction."""
    nx, nz = 34, 96
    x, z = np.meshgrid(np.linspace(-1, 1, nx) * layout.BASIN_X, np.linspace(-1, 1, nz) * layout.BASIN_Z, indexing="ij")
    n = nx * nz
    places = np.stack((x.ravel(), np.full(n, -layout.WATER), z.ravel()), 1) + rng.normal(size=(n, 3)) * [
        0.03,
        0.004,
        0.03,
    ]
    surfels = level(places.astype(np.float32), np.array([[0.13, 0.075]]) * rng.uniform(0.8, 1.2, (n, 1)))
    reach = np.hypot(places[:, 0], places[:, 2])
    ripple = np.sin(reach * 16 + noise(places.astype(np.float32), 1.5, rng)) * np.exp(-reach / 2.2)
    ripple = ripple + 0.7 * noise((places * [1.0, 1.0, 2.2]).astype(np.float32), 0.7, rng)
    colour = np.array([0.13, 0.22, 0.24]) * (1 + 0.22 * ripple)[:, None]
    tilt = np.zeros((n, 3, 3))
    tilt[:, 1] = -np.array([0.20, 0.26, 0.30]) * (0.8 + 0.3 * ripple)[:, None]
    # ripples catch the sun where they lean towards it
    glint = (ripple.clip(0, None) ** 2)[:, None, None] * np.array([0.16, 0.14, 0.1])
    tilt -= unit(SUN * [-1, 1, -1])[:, None] * glint * 0.8
    surfels = surfels.painted((0.1, 0.2, 0.2), opacity=0.3)
    return surfels, (colour + 0.12).astype(np.float32), tilt.astype(np.float32)


def jets(rng: np.random.Generator) -> Surfels:
    """Water in the air: a plume on top, curtains from both bowls, foam where they land."""
    parts = []
    n = 160
    rise = rng.uniform(size=n)
    plume = np.stack((rng.normal(size=n) * 0.025, -layout.FOUNTAIN_HEIGHT - 0.42 * rise, rng.normal(size=n) * 0.025), 1)
    parts.append(plume)
    for radius, top, bottom, count in ((0.4, 1.6, 1.1, 260), (0.85, 1.09, layout.WATER, 700)):
        turn = np.floor(rng.uniform(0, 28, count)) / 28 * 2 * np.pi + rng.normal(size=count) * 0.02
        fall = rng.uniform(size=count)
        out = radius + 0.12 * np.sqrt(fall)
        parts.append(np.stack((np.cos(turn) * out, -(top + (bottom - top) * fall), np.sin(turn) * out), 1))
    places = np.concatenate(parts).astype(np.float32)
    streaks = flat(
        places,
        np.broadcast_to(np.eye(3, dtype=np.float32), (len(places), 3, 3)),
        np.array([0.012, 0.055, 0.012]) * rng.uniform(0.7, 1.4, (len(places), 1)),
    )
    turn, reach = rng.uniform(0, 2 * np.pi, 260), 0.97 + rng.normal(size=260) * 0.07
    foam = np.stack((np.cos(turn) * reach, np.full(260, -layout.WATER - 0.01), np.sin(turn) * reach), 1)
    spots = level(foam.astype(np.float32), np.full((260, 2), 0.035))
    return join(
        streaks.painted((0.75, 0.82, 0.85), opacity=0.32, wrap=1.0),
        spots.painted((0.7, 0.75, 0.76), opacity=0.4, wrap=1.0),
    )


def landscape(rng: np.random.Generator) -> Surfels:
    """Meadow, cypresses and three ridges of hills that fade into the haze; colours as they are to be shown."""
    parts = []
    n = 1500
    reach = 14 + 106 * np.sqrt(rng.uniform(size=n))
    turn = rng.uniform(0, 2 * np.pi, n)
    places = np.stack((np.cos(turn) * reach, np.full(n, 0.3), np.sin(turn) * reach), 1)
    inside = (np.abs(places[:, 0]) < layout.OUTER_X + 1) & (np.abs(places[:, 2]) < layout.OUTER_Z + 1)
    places = places[~inside].astype(np.float32)
    meadow = level(places, np.full((len(places), 2), 3.2))
    shade = (0.9 + 0.12 * noise(places, 20, rng))[:, None]
    parts.append(meadow.painted((np.array([0.50, 0.51, 0.30]) * shade).astype(np.float32)))
    haze = np.array([0.75, 0.80, 0.86])
    for k, (distance, high, step) in enumerate(((95, 13, 2.3), (135, 22, 3.4), (180, 34, 4.6))):
        turns = np.arange(0, 2 * np.pi, step / distance)
        ring = np.stack((np.cos(turns), np.sin(turns)), 1).astype(np.float32)
        crest = high * (0.55 + 0.3 * noise(ring, 0.9, rng))
        rows = max(3, round(high / step))
        for row in range(rows):
            t = (row + 0.5) / rows
            level_ = crest * t
            places = np.stack((ring[:, 0] * distance, -level_, ring[:, 1] * distance), 1)
            normal = np.stack((-ring[:, 0], 0 * level_, -ring[:, 1]), 1)
            tangent = np.stack((-ring[:, 1], 0 * level_, ring[:, 0]), 1)
            frames = np.stack((tangent, np.cross(normal, tangent), normal), 1)
            tall = np.maximum(crest / rows, 0.5) * 0.75
            hill = flat(places, frames, np.stack((0 * tall + step * 0.75, tall, 0 * tall + 0.3), 1))
            near = np.array([0.33, 0.39, 0.25]) * (1 + 0.1 * noise(places.astype(np.float32), 12, rng))[:, None]
            fade = 0.35 + 0.2 * k + 0.05 * (1 - t)
            parts.append(hill.painted((near * (1 - fade) + haze * fade).astype(np.float32), opacity=0.98))
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
        parts.append(spire.painted((np.array([0.045, 0.075, 0.03]) * tint).astype(np.float32), wrap=1.0))
    return join(*parts)


def benches(detail: float, rng: np.random.Generator) -> Surfels:
    """Stone benches against the gallery's long walls."""
    parts = []
    for side in (-1, 1):
        for z in (-7.2, -2.4, 2.4, 7.2):
            x = side * (layout.OUTER_X - 0.35)
            seat = box((x - 0.25, -0.62, z - 0.9), (0.5, 0.1, 1.8), 0.09 / detail, rng, bottom=True)
            parts.append(seat.painted(stone(seat.positions, np.array([0.56, 0.50, 0.41], np.float32), rng), gloss=0.4))
    return join(*parts)


def sky(rng: np.random.Generator) -> Surfels:
    """A dome of large Gaussians in every direction above the horizon: gradient, clouds and the sun's glow."""
    n = 5000
    k = np.arange(n) + 0.5  # a Fibonacci lattice covers a sphere evenly
    height = 1 - 1.12 * k / n  # from the zenith to a little below the horizon
    turn = np.pi * (1 + 5**0.5) * k
    flat_ = np.sqrt(1 - height**2)
    direction = np.stack((flat_ * np.cos(turn), -height, flat_ * np.sin(turn)), 1)
    colour = sky_colour(direction, rng)
    spacing = SKY_RADIUS * np.sqrt(2 * np.pi * 1.12 / n)
    tangent = unit(np.cross(direction, [0.0, 1.0, 0.1]))
    frames = np.stack((tangent, np.cross(direction, tangent), direction), 1)
    sizes = np.broadcast_to(spacing * np.array([0.68, 0.68, 0.02]), (n, 3))
    dome = flat(direction * SKY_RADIUS, frames, sizes).painted(colour, opacity=0.98)
    glow = np.repeat(SUN[None], 4, 0)
    tangent = unit(np.cross(glow, [0.0, 1.0, 0.1]))
    frames = np.stack((tangent, np.cross(glow, tangent), glow), 1)
    width = SKY_RADIUS * np.array([0.012, 0.012, 0.03, 0.075])
    sun = flat(glow * SKY_RADIUS * 0.98, frames, np.stack((width, width, 0 * width + 1), 1))
    warm = np.array([[1, 0.99, 0.95], [1, 0.99, 0.95], [1, 0.97, 0.88], [1, 0.95, 0.85]], np.float32)
    sun = replace(sun.painted(warm), opacity=np.array([0.99, 0.99, 0.6, 0.3], np.float32))
    return join(dome, sun)


def sky_colour(direction: Floats, rng: np.random.Generator) -> Floats:
    """Display colour [N, 3] of the sky in a direction [N, 3]."""
    height = (-direction[:, 1]).clip(0, 1)[:, None]
    zenith, middle, horizon = np.array([0.22, 0.42, 0.70]), np.array([0.48, 0.67, 0.87]), np.array([0.90, 0.89, 0.84])
    t = height**0.5
    colour = np.where(
        t < 0.45, horizon + (middle - horizon) * (t / 0.45), middle + (zenith - middle) * ((t - 0.45) / 0.55)
    )
    to_sun = (direction @ SUN).clip(0, 1)[:, None]
    colour = colour + np.array([0.22, 0.16, 0.06]) * to_sun**8 + np.array([0.12, 0.09, 0.05]) * to_sun**2 * (1 - height)
    # clouds live on a plane, so that they grow smaller towards the horizon
    plane = (direction[:, [0, 2]] / (0.18 + height)).astype(np.float32)
    cover = noise(plane, 2.6, rng) + 0.45 * noise(plane * np.array([1, 1.6], np.float32), 0.8, rng)
    cloud = np.clip((cover - 0.25) / 0.9, 0, 1)[:, None] * np.clip((height - 0.05) / 0.15, 0, 1) * 0.85
    white = np.array([0.97, 0.95, 0.92]) + np.array([0.03, 0.01, -0.04]) * to_sun**2
    dark = np.array([0.70, 0.73, 0.79])
    inside = np.clip((cover - 0.9) / 1.2, 0, 1)[:, None]
    colour = colour * (1 - cloud) + (white * (1 - 0.7 * inside) + dark * 0.7 * inside) * cloud
    shown: Floats = colour.clip(0, 1)
    return shown
