"""Puts the courtyard together: geometry, light, and its mirror image below the water."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from tigas_common.wire.render import StartCamera
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.demo import layout
from tigas_render.scenes.demo.arcade import arcade
from tigas_render.scenes.demo.gallery import gallery
from tigas_render.scenes.demo.ground import ground
from tigas_render.scenes.demo.light import shade, to_gaussians
from tigas_render.scenes.demo.plants import plants
from tigas_render.scenes.demo.roofs import roofs, tower
from tigas_render.scenes.demo.sky import landscape, sky
from tigas_render.scenes.demo.surfels import Floats, Surfels, join
from tigas_render.scenes.demo.water import jets, water
from tigas_render.scenes.ladder import FILE as LADDER_FILE
from tigas_render.scenes.ladder import read_ladder
from tigas_render.scenes.metadata import SceneMetadata
from tigas_render.scenes.source import SceneSource

SEED = 20_240_229

DEMO_METADATA = SceneMetadata(
    name="Courtyard",
    up=(0.0, -1.0, 0.0),
    camera=StartCamera(position=(-0.9, -1.75, -9.7), look_at=(0.35, -1.75, 0.0)),
    background=(0.86, 0.86, 0.83),
)
"""What a scene.json would say."""


def demo_scene() -> Gaussians:
    """The courtyard, about 300,000 Gaussians of SH degree 1, in metres with y pointing down; the same at every call."""
    rng = np.random.default_rng(SEED)
    near = _shaded(_lit_parts(1.0, rng), rng)
    far = _shaded(join(landscape(rng), sky(rng)), rng, lit=False)
    mirrored = _seen_in_water(*_shaded(_lit_parts(0.4, rng), rng), rng)
    mirrored_far = _seen_in_water(*far, rng)
    return to_gaussians(*_concatenate(near, mirrored, mirrored_far, water(rng), far))


def _fingerprint() -> str:
    """Of the generator, so that pictures of an earlier courtyard are not taken for pictures of this one."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"\0".join(source.read_bytes() for source in sources)).hexdigest()


DEMO_SOURCE = SceneSource(
    id="courtyard",
    metadata=DEMO_METADATA,
    version=_fingerprint(),
    open=lambda _: demo_scene().batches(),
    sh_degree=1,
    memory_bytes=30_000_000,
    ladder=read_ladder(Path(__file__).with_name(LADDER_FILE)),
)
"""The courtyard as the registry offers it."""


Shaded = tuple[Surfels, Floats, Floats]
"""Surfels with their display colour and its change with the viewing direction."""


def _lit_parts(detail: float, rng: np.random.Generator) -> Surfels:
    """Everything that the sun lights; the number of surfels goes with the square of `detail`."""
    return join(
        ground(detail, rng),
        arcade(detail, rng),
        gallery(detail, rng),
        roofs(detail, rng),
        tower(detail, rng),
        plants(detail, rng),
        jets(rng),
    )


def _shaded(surfels: Surfels, rng: np.random.Generator, *, lit: bool = True) -> Shaded:
    return surfels, *shade(surfels, rng, lit=lit)


def _concatenate(*parts: Shaded) -> Shaded:
    return (
        join(*(part[0] for part in parts)),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] for part in parts]),
    )


def _seen_in_water(surfels: Surfels, colour: Floats, tilt: Floats, rng: np.random.Generator) -> Shaded:
    """The mirror image of what is above the water, as far as someone in the courtyard can see it in the basin.

    A copy below the surface is what photographs of still water turn into when they are reconstructed, too.
    """
    flip = np.array([1, -1, 1], np.float32)
    positions = surfels.positions * flip + np.array([0, -2 * layout.WATER, 0], np.float32)
    above = surfels.positions[:, 1] < -layout.WATER
    xs, zs = np.meshgrid(np.linspace(-9, 9, 8), np.linspace(-13, 13, 11), indexing="ij")
    seen = np.zeros(len(positions), bool)
    for height in (1.0, 1.7, 3.2):
        for x, z in zip(xs.ravel(), zs.ravel(), strict=True):
            t = (height - layout.WATER) / (positions[:, 1] + height).clip(1e-3)
            hit_x, hit_z = x + t * (positions[:, 0] - x), z + t * (positions[:, 2] - z)
            seen |= (np.abs(hit_x) < layout.BASIN_X + 0.1) & (np.abs(hit_z) < layout.BASIN_Z + 0.1)
    keep = above & seen
    # ripples shake the image sideways and draw it out
    shaken = positions + rng.normal(size=positions.shape).astype(np.float32) * np.array([0.04, 0.02, 0.04], np.float32)
    mirrored = replace(surfels, positions=shaken.astype(np.float32), frames=surfels.frames * flip)
    dim = np.array([0.80, 0.86, 0.86], np.float32)
    return mirrored.where(keep), colour[keep] * dim, tilt[keep] * flip[:, None] * dim
