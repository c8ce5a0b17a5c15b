"""Turns a frame to another pose, pixel by pixel of the result: what benchmarks.reprojection compares ways of doing.

The page warps a mesh forward (web/src/reproject); this asks for each pixel of the result where it was in the frame,
which needs no mesh, and differs only where something nearer hides what lies behind it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import grid_sample

from tigas_common.pose import Intrinsics, Pose
from tigas_experiments.quality.picture import Picture

Floats = NDArray[np.float64]
ROUNDS = 8
"""Of the search for the surface that a pixel of the result sees."""
STEP = 0.7
"""How far each goes: with whole steps, the search swings from side to side at the edges of what is near."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture, and from where it was taken."""

    picture: Picture
    pose: Pose
    lens: Intrinsics


def with_margins(lens: Intrinsics, overscan: float) -> Intrinsics:
    """The lens of a frame that shows this share of the width and height more at each side."""
    x, y = round(lens.width * overscan), round(lens.height * overscan)
    return Intrinsics(lens.fx, lens.fy, lens.cx + x, lens.cy + y, lens.width + 2 * x, lens.height + 2 * y)


def cropped(frame: Frame, lens: Intrinsics) -> Picture:
    """What a viewer with `lens` sees of a frame that is shown as it came."""
    x, y = (frame.lens.width - lens.width) // 2, (frame.lens.height - lens.height) // 2
    return frame.picture[y : y + lens.height, x : x + lens.width]


def turned(frame: Frame, pose: Pose, lens: Intrinsics, inverse_depth: Floats | float) -> tuple[Picture, float]:
    """The frame as seen from `pose`, and the share of the result that lies outside the frame.

    inverse_depth: 1/z of the frame in 1/scene units, 0 for infinitely far: [h, w] over the whole frame, margins
    included, or one number: the inverse of the distance of a sphere around the frame's camera.
    Outside, the frame's border is stretched.
    """
    x, y = _sources(frame, pose, lens, inverse_depth)
    width, height = frame.lens.width, frame.lens.height
    outside = ~((x >= 0) & (x <= width) & (y >= 0) & (y <= height))
    return _sampled(frame.picture, x, y), float(outside.mean())


def _sources(frame: Frame, pose: Pose, lens: Intrinsics, inverse_depth: Floats | float) -> tuple[Floats, Floats]:
    """Where each pixel [H, W] of the result lies in the frame, in its pixels; NaN behind the camera.

    A point at inverse depth d along a ray u of the result, with t the result's camera in the frame's axes, is at
    t + s·u with z = 1/d, and thus s = (1/d - t_z) / u_z. Times d, so that infinitely far points work, too.
    """
    k = frame.lens
    to_frame = np.array(frame.pose.rotation).T
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    rays = np.stack([(columns - lens.cx) / lens.fx, (rows - lens.cy) / lens.fy, np.ones_like(rows)], axis=-1)
    u = rays @ (to_frame @ np.array(pose.rotation)).T
    t = to_frame @ (np.array(pose.position) - np.array(frame.pose.position))
    ahead = np.where(u[..., 2] > 1e-6, u[..., 2], np.nan)
    x, y = k.fx * u[..., 0] / ahead + k.cx, k.fy * u[..., 1] / ahead + k.cy
    if isinstance(inverse_depth, float) and inverse_depth == 0:
        return x, y
    d = np.zeros_like(x)
    for _ in range(ROUNDS):
        if isinstance(inverse_depth, float):  # of a sphere, so z is shorter along a slanted ray
            found = inverse_depth * np.sqrt(1 + ((x - k.cx) / k.fx) ** 2 + ((y - k.cy) / k.fy) ** 2)
        else:
            found = _at(inverse_depth, x / k.width, y / k.height)
        d += STEP * (np.nan_to_num(found) - d)
        s = (1 - t[2] * d) / ahead
        point = t * d[..., None] + s[..., None] * u
        z = np.where((s > 0) & (point[..., 2] > 1e-6), point[..., 2], np.nan)
        x, y = k.fx * point[..., 0] / z + k.cx, k.fy * point[..., 1] / z + k.cy
    return x, y


def _at(values: Floats, x: Floats, y: Floats) -> Floats:
    """Bilinear, x and y as shares of the width and height; the border's value outside."""
    found = grid_sample(torch.from_numpy(values)[None, None], _grid(x, y), "bilinear", "border", align_corners=False)
    result: Floats = found[0, 0].numpy()
    return result


def _sampled(picture: Picture, x: Floats, y: Floats) -> Picture:
    """Bicubic, x and y in pixels; the border's colour outside."""
    height, width = picture.shape[:2]
    source = torch.from_numpy(picture.astype(np.float64)).permute(2, 0, 1)[None]
    found = grid_sample(source, _grid(x / width, y / height), "bicubic", "border", align_corners=False)
    return found[0].permute(1, 2, 0).round().clamp(0, 255).numpy().astype(np.uint8)


def _grid(x: Floats, y: Floats) -> torch.Tensor:
    return torch.from_numpy(np.nan_to_num(np.stack([x, y], axis=-1) * 2 - 1, nan=-1).clip(-4, 4))[None]
