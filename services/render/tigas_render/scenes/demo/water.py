"""The basin's surface, and the water in the air above it."""

from __future__ import annotations

import numpy as np

from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.layout import SUN
from tigas_render.scenes.demo.materials import level
from tigas_render.scenes.demo.surfels import Floats, Surfels, flat, join, noise, unit


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
    surfels = surfels.painted((0.1, 0.2, 0.2), opacity=0.22)
    return surfels, (colour + 0.2).astype(np.float32), tilt.astype(np.float32)


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
