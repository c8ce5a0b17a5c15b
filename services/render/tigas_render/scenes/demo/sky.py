"""Beyond the walls: meadow, hills and the sky."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.layout import SUN
from tigas_render.scenes.demo.materials import level
from tigas_render.scenes.demo.surfels import Floats, Surfels, flat, join, noise, unit

SKY_RADIUS = 220.0


def landscape(rng: np.random.Generator) -> Surfels:
    """Meadow and three ridges of hills that fade into the haze; colours as they are to be shown."""
    parts = []
    for count, far, size, gap in ((1800, 130.0, 3.2, 9.0), (2600, 34.0, 0.9, 2.5)):
        i = np.arange(count) + 0.5  # a sunflower's lattice covers a disc evenly
        reach, turn = far * np.sqrt(i / count), np.pi * (1 + 5**0.5) * i
        places = np.stack((np.cos(turn) * reach, np.full_like(i, 0.3), np.sin(turn) * reach), 1)
        out = np.maximum(np.abs(places[:, 0]) - layout.OUTER_X, np.abs(places[:, 2]) - layout.OUTER_Z)
        # large Gaussians stay away from the walls, which they would show through; small ones fill the gap
        places = places[(out > gap) & ((out < 10) | (size > 1))].astype(np.float32)
        meadow = level(places, np.full((len(places), 2), size))
        shade = (0.9 + 0.12 * noise(places, 20, rng))[:, None]
        parts.append(meadow.painted(np.array([0.50, 0.51, 0.30]) * shade))
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
    sizes = np.broadcast_to(spacing * np.array([0.88, 0.88, 0.02]), (n, 3))
    dome = flat(direction * SKY_RADIUS, frames, sizes).painted(colour, opacity=0.8)
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
