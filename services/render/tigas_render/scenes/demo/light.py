"""Baked light: the sun with shadows, the sky as far as a place sees it, light bounced off the ground, and lamps.

Everything is computed in linear RGB, then tone-mapped, as the Gaussians' colours are what the screen shows.
"""

from __future__ import annotations

import numpy as np

from tigas_render.gaussians import Gaussians
from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.layout import SUN
from tigas_render.scenes.demo.surfels import Bools, Floats, Surfels, unit

SUN_COLOUR = np.array([3.3, 2.6, 1.75], np.float32)
SKY_COLOUR = np.array([0.52, 0.66, 0.95], np.float32)
BOUNCE_COLOUR = np.array([0.40, 0.32, 0.24], np.float32)
LAMP_COLOUR = np.array([1.9, 1.05, 0.42], np.float32)

SUN_SAMPLES, SKY_SAMPLES = 4, 10

SH_C0, SH_C1 = 0.28209479177387814, 0.4886025119029199
"""Constants of the real spherical harmonics of degree 0 and 1, as in INRIA's 3DGS."""


def tone(radiance: Floats) -> Floats:
    """Linear radiance to display values in 0..1: Narkowicz's fit of the ACES curve, then sRGB's gamma."""
    x = radiance * 0.62
    mapped = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    return mapped.clip(0, 1) ** np.float32(1 / 2.2)


def visible(points: Floats, directions: Floats) -> Floats:
    """[N] 0 or 1, with trees in between: whether light from `directions` [N, 3] reaches `points` [N, 3]."""
    x, y, z = np.ascontiguousarray(points.T)
    dx, dy, dz = np.ascontiguousarray(directions.T)
    light = np.ones(len(points), np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, across, half, side in (
            (x, z, layout.COURT_X, layout.COURT_Z),
            (z, x, layout.COURT_Z, layout.COURT_X),
        ):
            d_axis, d_across = (dx, dz) if axis is x else (dz, dx)
            for plane in (-half, half):
                t = (plane - axis) / d_axis
                height = -(y + t * dy)
                u = across + t * d_across
                hit = (t > 0.03) & (np.abs(u) < side) & (height > 0) & (height < layout.EAVES)
                inward = d_axis * plane < 0
                light[hit & ~(inward & _in_arch(u, height, layout.BAYS_Z if axis is x else layout.BAYS_X))] = 0
            outer = layout.OUTER_X if axis is x else layout.OUTER_Z
            t = (np.copysign(np.float32(outer), d_axis) - axis) / d_axis
            light[(np.abs(axis) < outer) & (-(y + t * dy) < layout.EAVES) & (t > 0)] = 0
        # the gallery's roof, as a level slab
        t = (-layout.CEILING - y) / dy
        hx, hz = np.abs(x + t * dx), np.abs(z + t * dz)
        over = (t > 0.03) & (hx < layout.OUTER_X) & (hz < layout.OUTER_Z)
        light[over & ((hx > layout.COURT_X - 0.2) | (hz > layout.COURT_Z - 0.2))] = 0
    balls = [((tx, -height, tz), radius, 0.12) for tx, tz, height, radius in layout.TREES]
    balls += [((px, -layout.POT_CROWN[0], pz), layout.POT_CROWN[1], 0.1) for px, pz in layout.POTS]
    balls += [((px, -0.28, pz), 0.26, 0.0) for px, pz in layout.POTS]
    balls += [((0.0, -0.75, 0.0), 0.55, 0.1)]
    for centre, radius, leak in balls:
        reach = np.float32(6 * radius)
        near = np.flatnonzero(
            (np.abs(x - centre[0]) < reach) & (np.abs(y - centre[1]) < reach) & (np.abs(z - centre[2]) < reach)
        )
        light[near] *= _through_ball(points[near], directions[near], centre, radius, leak)
    return light


def _in_arch(u: Floats, height: Floats, bays: int) -> Bools:
    """Whether a point of an arcade's plane lies in an opening."""
    offset = (u / layout.BAY + (0.5 if bays % 2 else 0.0)) % 1.0 - 0.5
    offset = np.abs(offset) * layout.BAY
    above = np.maximum(height - layout.SPRING, 0)
    in_shaft = offset < np.where(above > 0, layout.ARCH_RADIUS, layout.BAY / 2 - layout.COLUMN_RADIUS)
    inside: Bools = in_shaft & (offset**2 + above**2 < np.where(above > 0, layout.ARCH_RADIUS**2, np.inf))
    return inside


def _through_ball(points: Floats, directions: Floats, centre: tuple[float, ...], radius: float, leak: float) -> Floats:
    """How much light passes a ball of leaves; points inside it are left alone."""
    to = np.asarray(centre, np.float32) - points
    along = _dot(to, directions)
    distance2 = _dot(to, to)
    gap = (distance2 - along * along) / radius**2
    passes: Floats = 1 - np.clip((1.1 - gap) / 0.4, 0, 1) * (1 - leak) * (along > 0) * (
        distance2 > (1.05 * radius) ** 2
    )
    return passes


def _dot(a: Floats, b: Floats) -> Floats:
    """[N] products of [N, 3], column by column: several times as fast as a sum over such a short axis."""
    product: Floats = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return product


def illuminate(surfels: Surfels, rng: np.random.Generator) -> Floats:
    """Light that falls on each surfel, [N, 3] linear."""
    n = len(surfels)
    up = np.array([0, -1, 0], np.float32)
    normals, wrap = surfels.normals, surfels.wrap
    start = (surfels.positions + 0.03 * normals * (wrap < 0.5)[:, None]).astype(np.float32)
    sun = np.zeros(n, np.float32)
    tangents = surfels.frames[:, :2] * surfels.sizes[:, :2, None]
    for _ in range(SUN_SAMPLES):
        spread = rng.normal(size=(n, 2, 1)).astype(np.float32) * 0.6
        direction = unit(SUN + rng.normal(size=(n, 3)) * 0.008).astype(np.float32)
        sun += visible(start + (tangents * spread).sum(1), direction) / SUN_SAMPLES
    facing = normals @ SUN.astype(np.float32)
    lambert = np.where(wrap > 0.5, 0.35 + 0.45 * np.abs(facing), np.maximum(facing, 0))
    sky = np.zeros(n, np.float32)
    total = np.full(n, 1e-3, np.float32)
    for i in range(SKY_SAMPLES):
        height = np.float32(0.06) + 0.94 * (i + rng.uniform(size=n)) / SKY_SAMPLES
        turn = 2 * np.pi * ((i * 0.618) + rng.uniform(size=n) / 3)
        flat = np.sqrt(1 - height**2)
        direction = np.stack((flat * np.cos(turn), -height, flat * np.sin(turn)), axis=1).astype(np.float32)
        weight = np.where(wrap > 0.5, 0.6, np.maximum(_dot(direction, normals), 0))
        sky += weight * visible(start, direction)
        total += weight
    openness = _smooth(sky / total, start, normals, rng)
    hemisphere = 0.5 + 0.5 * np.where(wrap > 0.5, 0.6, normals @ up)
    # what the sunlit court throws back: strongest on what looks down or sideways, weaker deep in the gallery
    inside = np.maximum(np.abs(start[:, 0]) - layout.COURT_X, np.abs(start[:, 2]) - layout.COURT_Z).clip(0, None)
    bounce = (1.05 - 0.55 * hemisphere) * np.exp(-inside / 4.5) * (0.55 + 0.45 * np.exp(start[:, 1] / 5))
    light: Floats = sun[:, None] * lambert[:, None] * SUN_COLOUR
    light += (openness * (0.25 + 0.75 * hemisphere))[:, None] * SKY_COLOUR
    light += bounce[:, None] * BOUNCE_COLOUR * _contact(start)[:, None]
    for lamp in layout.lamp_places():
        to = lamp - start
        distance2 = _dot(to, to)
        cosine = np.maximum(_dot(to, normals) / np.sqrt(distance2), 0.15)
        light += (cosine * 0.42 / (0.25 + distance2) * (distance2 < 25))[:, None] * LAMP_COLOUR
    return light


def _smooth(values: Floats, points: Floats, normals: Floats, rng: np.random.Generator) -> Floats:
    """Means over neighbours that face the same way: of three lattices of cells, each shifted at random."""
    result = np.zeros(len(values))
    facing = np.round(normals * 1.4).astype(np.int64) @ np.array([1, 3, 9])
    for size in (0.35, 0.45, 0.6):
        cell = np.floor(points / size + rng.uniform(size=3)).astype(np.int64)
        key = cell @ np.array([73_856_093, 19_349_663, 83_492_791]) + facing
        _, index = np.unique(key, return_inverse=True)
        result += (np.bincount(index, values) / np.bincount(index))[index] / 3
    return result


def _contact(points: Floats) -> Floats:
    """Corners are darker: [N] falls where floor and ceiling of the gallery meet its walls."""
    wall = np.minimum(layout.OUTER_X - np.abs(points[:, 0]), layout.OUTER_Z - np.abs(points[:, 2])).clip(0, None)
    floor = (-points[:, 1]).clip(0, None)
    ceiling = (layout.CEILING + points[:, 1]).clip(0, None)
    near = np.exp(-np.hypot(wall, floor) / 0.35) + np.exp(-np.hypot(wall, ceiling) / 0.5)
    contact: Floats = (1 - 0.6 * near.clip(0, 1)) * (1 - 0.25 * np.exp(-floor / 0.2))
    return contact


def shade(surfels: Surfels, rng: np.random.Generator, *, lit: bool = True) -> tuple[Floats, Floats]:
    """Display colour [N, 3] and the change with the viewing direction [N, 3 (axis), 3 (RGB)], both in display values.

    `lit` False: the albedo is the colour to show, as for the sky.
    """
    if not lit:
        return surfels.albedo, np.zeros((len(surfels), 3, 3), np.float32)
    light = illuminate(surfels, rng)
    colour = tone(surfels.albedo * light + surfels.emission)
    # a highlight is brightest for a viewer in the mirrored direction of the sun; degree 1 gives it a broad lobe
    normals = surfels.normals
    mirrored = 2 * (normals @ SUN.astype(np.float32))[:, None] * normals - SUN.astype(np.float32)
    strength = surfels.gloss * light.max(1).clip(0, 2.5)
    tilt = -mirrored[:, :, None] * strength[:, None, None] * np.array([0.09, 0.082, 0.07], np.float32)
    # at grazing angles a polished level surface shows the sky
    grazing = (surfels.gloss * (normals[:, 1] < -0.7))[:, None] * np.array([0.07, 0.085, 0.11], np.float32)
    tilt[:, 1] -= grazing
    return colour + 0.5 * grazing, tilt.astype(np.float32)


def to_gaussians(surfels: Surfels, colour: Floats, tilt: Floats) -> Gaussians:
    """Gaussians that show `colour` + direction · `tilt`."""
    sh = np.zeros((len(surfels), 4, 3), np.float32)
    sh[:, 0] = (colour - 0.5) / SH_C0
    sh[:, 1] = -tilt[:, 1] / SH_C1  # basis functions of degree 1 are −C1·y, C1·z, −C1·x
    sh[:, 2] = tilt[:, 2] / SH_C1
    sh[:, 3] = -tilt[:, 0] / SH_C1
    return Gaussians(
        means=np.ascontiguousarray(surfels.positions),
        scales=np.ascontiguousarray(surfels.sizes),
        quaternions=_quaternions(surfels.frames),
        opacities=np.ascontiguousarray(surfels.opacity),
        sh=sh,
    )


def _quaternions(frames: Floats) -> Floats:
    """[N, 4] w, x, y, z of rotations whose rows are the turned axes (the largest component first, for precision)."""
    m = frames.astype(np.float64).transpose(0, 2, 1)  # columns are the axes
    m = m * np.sign(np.linalg.det(m))[:, None, None]
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    yx, zx, xy = m[:, 1, 0], m[:, 2, 0], m[:, 0, 1]
    zy, xz, yz = m[:, 2, 1], m[:, 0, 2], m[:, 1, 2]
    candidates = np.stack(
        (
            np.stack((1 + xx + yy + zz, zy - yz, xz - zx, yx - xy), 1),
            np.stack((zy - yz, 1 + xx - yy - zz, yx + xy, xz + zx), 1),
            np.stack((xz - zx, yx + xy, 1 - xx + yy - zz, zy + yz), 1),
            np.stack((yx - xy, xz + zx, zy + yz, 1 - xx - yy + zz), 1),
        ),
        1,
    )
    best = np.argmax(np.stack((xx + yy + zz, xx, yy, zz), 1), axis=1)
    chosen = candidates[np.arange(len(m)), best]
    quaternions: Floats = (chosen / np.linalg.norm(chosen, axis=1, keepdims=True)).astype(np.float32)
    return quaternions
