"""The coarse depth of a view as a frame carries it, and others to hold it against, for benchmarks.reprojection."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_common.pose import Intrinsics, Pose
from tigas_render.encode.depth_segment import IDENTIFIER, coded, quantised, with_depth
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import NEAR_PLANE, Camera, Depth
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.depth import OPACITY_MIN, PIXELS

FULL = 640 * 360
NEAREST_SHARE = 0.999
"""The share of pixels that lie no nearer than the code 255 of what is painted."""
MEDIAN_BINS = 96
BEFORE_IMAGE = 2 + 2 + 2 + len(IDENTIFIER) + 4
"""Bytes of a JPEG's start, the segment's marker and length, its name, and `nearest`."""
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Kind:
    """A way to paint depth, which is then packed as the render service packs its own."""

    name: str
    pixels: int = PIXELS
    median: bool = False
    """The inverse depth that half of a pixel's light comes from behind of, in place of the mean."""
    shines_through: bool = False
    """What is behind a pixel that is not quite covered counts as infinitely far."""
    packed: bool = True


PAINTED = (
    Kind("painted mean"),
    Kind("painted mean, full size, not packed", pixels=FULL, packed=False),
    Kind("painted mean, half as many pixels", pixels=PIXELS // 2),
    Kind("painted mean, shining through", shines_through=True),
    Kind("painted median", median=True),
)


def packed(inverse: Depth) -> tuple[Floats, int]:
    """A depth as it arrives, and the bytes that it took."""
    data = with_depth(b"\xff\xd8", coded(inverse))
    nearest, _ = quantised(inverse)
    codes = np.asarray(Image.open(io.BytesIO(data[BEFORE_IMAGE:])).convert("L"), np.float64)
    return nearest * codes / 255, len(data) - 2


class DepthScene:
    """Draws inverse depth by painting each Gaussian with its own."""

    def __init__(self, rasterizer: CpuRasterizer, gaussians: Gaussians) -> None:
        count = len(gaussians)
        plain = replace(gaussians, sh=np.zeros((count, 1, 3), np.float32))
        self._rasterizer = rasterizer
        self._scene = rasterizer.prepare(plain)

    def inverse(self, pose: Pose, lens: Intrinsics, kind: Kind) -> tuple[Floats, int]:
        """1/z in 1/scene units, [h, w] over the whole of `lens`, and the bytes that it took; 0 if not packed."""
        small = _smaller(lens, kind.pixels)
        camera = Camera(pose, small, display_scale=max(1.0, lens.width / small.width))
        inverse = self._inverse_z(pose)
        most = max(float(inverse.max()), 1e-9)
        for _ in range(2):  # once to find what is in sight, once with all codes
            codes = self._painted(np.clip(inverse / most, 0, 1), camera)
            most *= max(float(np.quantile(codes, NEAREST_SHARE)), 1.0) / 255
        share = np.clip(inverse / most, 0, 1)
        if kind.median:
            codes = self._median(share, camera)
        elif kind.shines_through:
            codes = self._painted(share, camera)
        else:
            mean, covered = np.moveaxis(self._channels([share, np.ones_like(share)], camera)[..., :2], -1, 0)
            there = covered >= 255 * OPACITY_MIN
            codes = np.where(there, np.clip(255.0 * mean / np.maximum(covered, 1), 0, 255), 0).astype(np.uint8)
        inverse = most * codes.astype(np.float64) / 255
        return packed(inverse.astype(np.float32)) if kind.packed else (inverse, 0)

    def _painted(self, share: Floats, camera: Camera) -> NDArray[np.uint8]:
        """[h, w] codes of the mean of what Gaussians have [chunks, CHUNK]; nothing behind them counts as 0."""
        return self._channels([share], camera)[..., 0]

    def _median(self, share: Floats, camera: Camera) -> NDArray[np.uint8]:
        """From how much of the light comes from nearer than each of a row of thresholds."""
        thresholds = np.arange(1, MEDIAN_BINS) / MEDIAN_BINS
        found = np.zeros(0)
        for first in range(0, len(thresholds), 3):
            some = thresholds[first : first + 3]
            nearer = self._channels([(share > threshold).astype(np.float64) for threshold in some], camera)
            passed = (nearer[..., : len(some)] >= 128).sum(axis=-1)
            found = passed if first == 0 else found + passed
        codes: NDArray[np.uint8] = np.where(found > 0, (found + 0.5) * 255 / MEDIAN_BINS, 0).astype(np.uint8)
        return codes

    def _channels(self, values: list[Floats], camera: Camera) -> NDArray[np.uint8]:
        for channel in range(3):  # a packed coefficient of degree 0 is the colour less a half
            self._scene.sh[:, channel, :] = (values[min(channel, len(values) - 1)] - 0.5).reshape(-1, L.LANES)
        with self._rasterizer.render(self._scene, camera) as image:
            return image.to_host().copy()

    def _inverse_z(self, pose: Pose) -> Floats:
        """[chunks, CHUNK]; 0 of what is not drawn."""
        means = self._scene.geometry[:, L.MEAN_X : L.MEAN_Z + 1, :].astype(np.float64)
        forward = np.array(pose.rotation)[:, 2]
        z = np.einsum("a,cal->cl", forward, means) - forward @ np.array(pose.position)
        return np.where(z > NEAR_PLANE, 1 / np.maximum(z, NEAR_PLANE), 0)


def _smaller(lens: Intrinsics, pixels: int) -> Intrinsics:
    """The same view on so many pixels, or on its own if it has no more."""
    scale = min(1.0, math.sqrt(pixels / (lens.width * lens.height)))
    return lens.resized(round(lens.width * scale), round(lens.height * scale))
