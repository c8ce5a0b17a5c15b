"""Scenes and cameras that the rasteriser's tests share."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray

from tests.render.arrays import gaussians_of
from tigas_common.pose import Intrinsics, Matrix3, Pose, Vector3
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, Image
from tigas_render.raster.host_image import Pixels

LEVEL = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""A camera that looks along +z."""


def cloud(count: int, degree: int, seed: int = 0, size: float = 0.05) -> Gaussians:
    """A ball of `count` Gaussians of all shapes, opacities and colours around the origin."""
    random = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=random)

    return gaussians_of(
        means=normal(count, 3),
        scales=size * torch.exp(0.8 * normal(count, 3)),
        quaternions=torch.nn.functional.normalize(normal(count, 4), dim=1),
        opacities=torch.rand(count, generator=random),
        sh=0.5 * normal(count, (degree + 1) ** 2, 3),
    )


def balls(*centres: tuple[float, float, float], size: float, opacity: float, colours: list[list[float]]) -> Gaussians:
    """Round Gaussians of one size and given colours."""
    count = len(centres)
    return gaussians_of(
        means=centres,
        scales=np.full((count, 3), size),
        quaternions=[[1.0, 0.0, 0.0, 0.0]] * count,
        opacities=np.full(count, opacity),
        sh=((np.array(colours) - 0.5) / 0.28209479177387814)[:, None, :],
    )


def fives(places: NDArray[np.float64], step: float, size: float) -> Gaussians:
    """At each place, five small faint Gaussians in a row along x, the first of which is red and the others green."""
    count = 5 * len(places)
    return gaussians_of(
        means=np.repeat(places, 5, axis=0) + np.tile(np.outer(range(-2, 3), [step, 0, 0]), (len(places), 1)),
        scales=np.full((count, 3), size),
        quaternions=np.tile([1.0, 0, 0, 0], (count, 1)),
        opacities=np.full(count, 0.1),
        sh=np.tile([[[1.0, 0, 0]], *[[[0, 1.0, 0]]] * 4], (len(places), 1, 1)),
    )


def with_others_among_them(count: int, every: int, change: str) -> Gaussians:
    """Small Gaussians. One of every few is large or far away, and has a distinct colour."""
    everything = cloud(count, 0, size=0.02)
    chosen = np.arange(0, count, every)
    if change == "large":
        everything.scales[chosen] = 100.0
    else:
        everything.means[chosen] *= 1e4
    everything.sh[chosen] = 7
    return everything


def no_extent(scene: Gaussians) -> None:
    scene.scales.fill(0.0)
    scene.means.fill(1.0)


STRANGE: dict[str, Callable[[Gaussians], None]] = {
    "one place": lambda scene: scene.means.fill(1.0),
    "no size": lambda scene: scene.scales.fill(0.0),
    "no size, one place": no_extent,
    "huge": lambda scene: scene.scales.fill(1e6),
    "flat": lambda scene: scene.means.__setitem__((slice(None), 0), 0.0),
    "opaque": lambda scene: scene.opacities.fill(1.0),
    "size is no number": lambda scene: scene.scales.__setitem__(slice(0, None, 3), np.nan),
    "infinitely bright": lambda scene: scene.sh.__setitem__(slice(0, None, 3), np.inf),
}
"""Changes to a scene that make its levels of detail hard to make."""


def from_afar(distance: float) -> Camera:
    """A view along +z of the origin."""
    return Camera(Pose((0.0, 0.0, -distance), LEVEL), camera(640, 360).intrinsics)


def camera(
    width: int,
    height: int,
    pose: Pose | None = None,
    focal: float | None = None,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    display_scale: float = 1.0,
) -> Camera:
    """A camera at (0, 0, -4) looking at the origin, unless a pose is given."""
    focal = focal or 0.6 * max(width, height)
    pose = pose or Pose((0.0, 0.0, -4.0), LEVEL)
    return Camera(pose, Intrinsics(focal, focal, width / 2, height / 2, width, height), background, display_scale)


def pixels(image: Image) -> Pixels:
    """A copy of an image's pixels; closes the image."""
    with image:
        return image.to_host().copy()


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Peak signal-to-noise ratio of two pictures, in dB."""
    assert a.shape == b.shape
    error = np.mean((a.astype(np.float64) - b) ** 2)
    return math.inf if error == 0 else 10 * math.log10(255**2 / error)


def gsplat_frames(renders: Mapping[str, NDArray[Any]], name: str) -> Iterator[tuple[Camera, Pixels]]:
    """gsplat's pictures of a captured scene from a GPU, 640×360, with their views; `renders` is their file."""
    frames, matrices, k = renders[name], renders[f"{name}_w2c"].astype(float), renders[f"{name}_K"].tolist()
    intrinsics = Intrinsics(k[0][0], k[1][1], k[0][2], k[1][2], 640, 360)
    for frame, matrix in zip(frames, matrices, strict=True):
        rotation = matrix[:3, :3].T
        position, rows = (-rotation @ matrix[:3, 3]).tolist(), rotation.tolist()
        pose = Pose(cast(Vector3, tuple(position)), cast(Matrix3, tuple(map(tuple, rows))))
        yield Camera(pose, intrinsics), frame
