"""Surfaces as flat Gaussians: one primitive, a parametric surface, that every shape of the demo scene is made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Bools = NDArray[np.bool_]
Point = tuple[float, float, float]
Surface = Callable[[Floats, Floats], tuple[Any, Any, Any]]
"""Maps u [N] and v [N] in [0, 1] to x, y, z (each [N], or a number)."""

OVERLAP = 0.75
"""Standard deviation over spacing: enough overlap that a single layer lets less than 1 % of the light through."""


@dataclass(frozen=True, slots=True)
class Surfels:
    """N flat Gaussians with the material that they are made of, before light falls on them. Axes: y points down."""

    positions: Floats
    """[N, 3] metres."""
    frames: Floats
    """[N, 3, 3] the Gaussian's own axes as rows: two tangents, then the normal."""
    sizes: Floats
    """[N, 3] standard deviations along these axes, metres."""
    albedo: Floats
    """[N, 3] linear RGB."""
    opacity: Floats
    """[N]"""
    gloss: Floats
    """[N] strength of the highlight, 0 to 1."""
    wrap: Floats
    """[N] 0: lit from the front only, as stone; 1: light goes through, as leaves and water."""
    emission: Floats
    """[N, 3] linear RGB, added to what is reflected."""

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def normals(self) -> Floats:
        """[N, 3]"""
        return self.frames[:, 2]

    def painted(
        self, albedo: Floats | Point, *, opacity: float = 0.97, gloss: float = 0.0, wrap: float = 0.0
    ) -> Surfels:
        """The same surfels of another material."""
        n = len(self)
        return replace(
            self,
            albedo=np.broadcast_to(np.asarray(albedo, np.float32), (n, 3)),
            opacity=np.full(n, opacity, np.float32),
            gloss=np.full(n, gloss, np.float32),
            wrap=np.full(n, wrap, np.float32),
        )

    def glowing(self, emission: Floats | Point) -> Surfels:
        """The same surfels with light of their own."""
        return replace(self, emission=np.broadcast_to(np.asarray(emission, np.float32), (len(self), 3)))

    def where(self, keep: Bools | NDArray[np.int64]) -> Surfels:
        """Only the surfels for which `keep` [N] holds, or those that it lists."""
        return Surfels(*(getattr(self, field.name)[keep] for field in fields(self)))

    def moved(self, x: float, y: float, z: float, *, turn: float = 0.0) -> Surfels:
        """Turned by `turn` radians about the vertical axis through the origin, then shifted."""
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]], np.float32)
        return replace(
            self,
            positions=self.positions @ rotation + np.array([x, y, z], np.float32),
            frames=self.frames @ rotation,
        )


def join(*parts: Surfels) -> Surfels:
    """All surfels of all parts."""
    return Surfels(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Surfels)))


def scatter(parts: Surfels, places: Floats, turns: Floats) -> Surfels:
    """Copies of `parts`, one at each of `places` [M, 3], turned by `turns` [M] radians about the vertical axis."""
    return join(*(parts.moved(*map(float, p), turn=float(t)) for p, t in zip(places, turns, strict=True)))


def flat(positions: Floats, frames: Floats, sizes: Floats) -> Surfels:
    """Surfels of white, dull, opaque material."""
    n = len(positions)
    return Surfels(
        positions.astype(np.float32),
        frames.astype(np.float32),
        sizes.astype(np.float32),
        albedo=np.ones((n, 3), np.float32),
        opacity=np.full(n, 0.97, np.float32),
        gloss=np.zeros(n, np.float32),
        wrap=np.zeros(n, np.float32),
        emission=np.zeros((n, 3), np.float32),
    )


def surface(
    shape: Surface,
    nu: int,
    nv: int,
    rng: np.random.Generator,
    *,
    jitter: float = 0.2,
    overlap: float = OVERLAP,
    thickness: float = 0.1,
) -> Surfels:
    """nu × nv surfels spread over a parametric surface.

    The normal is ∂u × ∂v; `jitter` is in spacings, `thickness` is the normal's standard deviation over the smaller
    tangent's.
    """
    u, v = np.meshgrid((np.arange(nu) + 0.5) / nu, (np.arange(nv) + 0.5) / nv, indexing="ij")
    u = (u.ravel() + rng.uniform(-jitter, jitter, nu * nv) / nu).clip(0.25 / nu, 1 - 0.25 / nu)
    v = (v.ravel() + rng.uniform(-jitter, jitter, nu * nv) / nv).clip(0.25 / nv, 1 - 0.25 / nv)
    du, dv = 0.5 / nu, 0.5 / nv
    along_u = _evaluate(shape, u + du, v) - _evaluate(shape, u - du, v)
    along_v = _evaluate(shape, u, v + dv) - _evaluate(shape, u, v - dv)
    normal = unit(np.cross(along_u, along_v))
    tangent = unit(along_u)
    frames = np.stack((tangent, np.cross(normal, tangent), normal), axis=1)
    size_u = np.linalg.norm(along_u, axis=1)
    size_v = np.linalg.norm(np.cross(along_u, along_v), axis=1) / size_u.clip(1e-9)
    sizes = overlap * np.stack((size_u, size_v, thickness * np.minimum(size_u, size_v)), axis=1)
    return flat(_evaluate(shape, u, v), frames, sizes.clip(1e-4))


def rectangle(
    corner: Point, side_u: Point, side_v: Point, spacing: float, rng: np.random.Generator, **options: float
) -> Surfels:
    """A flat rectangle spanned by two sides from a corner; its normal is side_u × side_v."""
    c, a, b = (np.asarray(p, np.float64) for p in (corner, side_u, side_v))
    nu, nv = (max(1, round(float(np.linalg.norm(side)) / spacing)) for side in (a, b))
    return surface(
        lambda u, v: tuple(c[i] + a[i] * u + b[i] * v for i in range(3)),
        nu,
        nv,
        rng,
        **options,
    )


def box(corner: Point, size: Point, spacing: float, rng: np.random.Generator, *, bottom: bool = False) -> Surfels:
    """The faces of an upright box from its corner with the smallest coordinates, without the one that it stands on."""
    (x, y, z), (w, h, d) = corner, size
    faces = [
        rectangle((x, y, z), (0, 0, d), (w, 0, 0), spacing, rng, jitter=0.1),
        rectangle((x, y, z), (w, 0, 0), (0, h, 0), spacing, rng, jitter=0.1),
        rectangle((x + w, y, z), (0, 0, d), (0, h, 0), spacing, rng, jitter=0.1),
        rectangle((x + w, y, z + d), (-w, 0, 0), (0, h, 0), spacing, rng, jitter=0.1),
        rectangle((x, y, z + d), (0, 0, -d), (0, h, 0), spacing, rng, jitter=0.1),
    ]
    if bottom:
        faces.append(rectangle((x, y + h, z), (w, 0, 0), (0, 0, d), spacing, rng, jitter=0.1))
    outward = join(*faces)
    centre = np.array([x + w / 2, y + h / 2, z + d / 2], np.float32)
    return facing(outward, outward.positions - centre)


def turned(
    profile: list[tuple[float, float]], around: int, along: float, rng: np.random.Generator, **options: float
) -> Surfels:
    """A surface of revolution about the vertical axis: `profile` lists (radius, height) from the bottom up.

    `around` surfels a ring, rings about `along` metres apart.
    """
    radius, height = np.array(profile, np.float64).T
    length = np.concatenate(([0], np.cumsum(np.hypot(np.diff(radius), np.diff(height)))))

    def shape(u: Floats, v: Floats) -> tuple[Any, Any, Any]:
        r, h = np.interp(v * length[-1], length, radius), np.interp(v * length[-1], length, height)
        return r * np.cos(2 * np.pi * u), -h, r * np.sin(2 * np.pi * u)

    return surface(shape, around, max(2, round(length[-1] / along)), rng, **options)


def blobs(positions: Floats, size: Floats | float, rng: np.random.Generator, *, flatness: float = 1.0) -> Surfels:
    """Gaussians in random directions: round if `flatness` is 1, leaves if it is much smaller."""
    n = len(positions)
    normal = unit(rng.normal(size=(n, 3)))
    tangent = unit(np.cross(normal, rng.normal(size=(n, 3))))
    frames = np.stack((tangent, np.cross(normal, tangent), normal), axis=1)
    sizes = np.broadcast_to(np.asarray(size, np.float64), (n,))[:, None] * np.array([1, 0.5 + 0.5 * flatness, flatness])
    return flat(positions, frames, sizes)


def strokes(start: Floats, end: Floats, width: float, normal: Point, *, pieces: int) -> Surfels:
    """Thin straight lines from `start` [M, 3] to `end` [M, 3], each of `pieces` Gaussians."""
    t = ((np.arange(pieces) + 0.5) / pieces)[None, :, None]
    positions = (start[:, None] + (end - start)[:, None] * t).reshape(-1, 3)
    tangent = np.repeat(unit(end - start), pieces, axis=0)
    normals = np.broadcast_to(np.asarray(normal, np.float64), tangent.shape)
    frames = np.stack((tangent, np.cross(normals, tangent), normals), axis=1)
    length = np.repeat(np.linalg.norm(end - start, axis=1), pieces) / pieces
    return flat(positions, frames, np.stack((0.6 * length, np.full_like(length, width), 0 * length + 0.002), axis=1))


def facing(surfels: Surfels, outward: Floats) -> Surfels:
    """The same surfels with normals on the side of `outward` [N, 3]."""
    flip = np.where((surfels.normals * outward).sum(1) < 0, -1, 1).astype(np.float32)
    frames = surfels.frames.copy()
    frames[:, 1:] *= flip[:, None, None]  # two axes change sign, so that the frame stays a rotation
    return replace(surfels, frames=frames)


def noise(points: Floats, wavelength: float, rng: np.random.Generator) -> Floats:
    """Smooth noise [N] of about unit variance over `points` [N, D]: a sum of plane waves over three octaves."""
    result = np.zeros(len(points), np.float32)
    for octave in range(3):
        waves = rng.normal(size=(6, points.shape[1])) * (2.2 * 2**octave / wavelength)
        phases = rng.uniform(0, 2 * np.pi, 6)
        result += (0.55**octave / 1.9) * np.sin(points @ waves.T.astype(np.float32) + phases).sum(1)
    return result


def unit(vectors: Any) -> Any:
    """[..., 3] vectors of length one."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return vectors / np.sqrt(x * x + y * y + z * z).clip(1e-12)[..., None]


def _evaluate(shape: Surface, u: Floats, v: Floats) -> Any:
    return np.stack([np.broadcast_to(axis, u.shape) for axis in shape(u, v)], axis=1).astype(np.float64)
