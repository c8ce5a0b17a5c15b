"""The coarse depth of a view as a frame carries it, and finer ones to hold it against, for benchmarks.reprojection."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from tigas_common.pose import Intrinsics, Pose
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import NEAR_PLANE, Camera
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.raster.cpu import layout as L

PIXELS = 184 * 104
"""Of a depth as frames carry it."""
FULL = 640 * 360
NEAREST_SHARE = 0.999
"""The share of pixels that lie no nearer than the code 255: a floater before the camera must not take all codes."""
MEDIAN_BINS = 96
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Kind:
    """A way to make and send depth."""

    name: str
    pixels: int = PIXELS
    median: bool = False
    """The inverse depth that half of a pixel's light comes from behind of, in place of the mean."""
    of_what_is_there: bool = False
    """The mean over what is drawn alone; otherwise what shines through counts as infinitely far."""
    webp: int | None = 80
    """Quality of the lossy WebP; None sends the codes as they are."""


KINDS = (
    Kind("expected, as sent"),
    Kind("expected, lossless", webp=None),
    Kind("expected, WebP 50", webp=50),
    Kind("expected, full size", pixels=FULL, webp=None),
    Kind("expected, half as many", pixels=PIXELS // 2),
    Kind("of what is there", of_what_is_there=True),
    Kind("of what is there, lossless", of_what_is_there=True, webp=None),
    Kind("median, as sent", median=True),
)


class DepthScene:
    """Draws inverse depth by painting each Gaussian with its own."""

    def __init__(self, rasterizer: CpuRasterizer, gaussians: Gaussians) -> None:
        count = len(gaussians)
        plain = Gaussians(
            gaussians.means, gaussians.scales, gaussians.quaternions, gaussians.opacities, torch.zeros(count, 1, 3)
        )
        self._rasterizer = rasterizer
        self._scene = rasterizer.prepare(plain)

    def inverse(self, pose: Pose, lens: Intrinsics, kind: Kind) -> tuple[Floats, int]:
        """1/z in 1/scene units, [h, w] over the whole of `lens`, and the bytes that were sent for it."""
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
        elif kind.of_what_is_there:
            inverse, covered = np.moveaxis(self._channels([share, np.ones_like(share)], camera)[..., :2], -1, 0)
            codes = np.where(covered > 8, np.clip(255.0 * inverse / np.maximum(covered, 1), 0, 255), 0).astype(np.uint8)
        else:
            codes = self._painted(share, camera)
        codes, sent = _sent(codes, kind.webp)
        return most * codes.astype(np.float64) / 255, sent

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


def _sent(codes: NDArray[np.uint8], quality: int | None) -> tuple[NDArray[np.uint8], int]:
    """The codes as they arrive, and how many bytes they took."""
    file = io.BytesIO()
    if quality is None:
        Image.fromarray(codes).save(file, "PNG", optimize=True)
        return codes, file.tell()
    Image.fromarray(codes).convert("RGB").save(file, "WEBP", quality=quality, method=4)
    return np.asarray(Image.open(file).convert("L")), file.tell()
