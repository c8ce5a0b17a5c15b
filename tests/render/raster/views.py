"""Scenes and cameras that the rasteriser's tests share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
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
