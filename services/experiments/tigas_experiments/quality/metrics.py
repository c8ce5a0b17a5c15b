"""The six metrics of a picture against ground truth: names, variants, and which of them can be computed here.

PSNR and SSIM need nothing else; LPIPS and DISTS need weights and a device, VMAF and VIFp need ffmpeg.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from tigas_common.errors import StartError
from tigas_experiments.errors import MetricUnavailable
from tigas_experiments.quality.picture import MAX_PSNR_DB, Picture, compare

if TYPE_CHECKING:  # heavy
    from tigas_experiments.quality.perceptual import Perceptual

Name = Literal["psnr", "ssim", "vmaf", "vif", "lpips", "dists"]
VIDEO: tuple[Name, ...] = ("vmaf", "vif")
"""Metrics computed on a sequence of pictures."""
MAX_BATCH_PIXELS = 2_000_000
"""Pixels above which pictures are compared one at a time, as DISTS takes 1.6 GB per megapixel of a pair."""


@dataclass(frozen=True, slots=True)
class PictureMetric:
    name: Name
    """Field in scores.ndjson, and name in commands and CSV files."""
    title: str
    variant: str
    """Exact definition and input."""
    unit: str
    digits: int
    better: Literal["high", "low"]

    @property
    def heading(self) -> str:
        unit = f", {self.unit}" if self.unit else ""
        return f"{self.title}{unit} ({self.better}er is better)"


PSNR = PictureMetric("psnr", "PSNR", f"of 8-bit RGB, at most {MAX_PSNR_DB:g} dB", "dB", 1, "high")
SSIM = PictureMetric("ssim", "SSIM", "Wang et al. 2004, Gaussian weights, mean over R, G and B", "", 3, "high")
VMAF = PictureMetric("vmaf", "VMAF", "v0.6.1, on the samples of a run as a video, in their order", "", 1, "high")
VIF = PictureMetric("vif", "VIFp", "pixel domain, 4 scales, on luma (libvmaf's float_vif)", "", 3, "high")
LPIPS = PictureMetric("lpips", "LPIPS", "v0.1, AlexNet", "", 3, "low")
DISTS = PictureMetric("dists", "DISTS", "VGG16, at the picture's own size", "", 3, "low")
PICTURE_METRICS = (PSNR, SSIM, VMAF, VIF, LPIPS, DISTS)
Measure = Callable[[Sequence[Picture], Picture], list[tuple[float, ...]]]
"""Computes values for each picture against one ground truth of the same size."""


class Meter(NamedTuple):
    """A function that computes metrics of single pictures."""

    names: tuple[Name, ...]
    measure: Measure


@dataclass(slots=True)
class Meters:
    """The requested metrics that are available."""

    single: list[Meter] = field(default_factory=list)
    video: bool = False
    """Whether VMAF and VIFp are available."""
    unavailable: list[str] = field(default_factory=list)
    """One sentence for each unavailable metric."""

    @classmethod
    def create(cls, names: Sequence[Name], device: str) -> Meters:
        """The available ones of these metrics. Raises StartError if the device does not exist."""
        from tigas_experiments.quality import perceptual, vmaf

        found = cls()
        if {"psnr", "ssim"} & set(names):
            found.single.append(Meter(("psnr", "ssim"), _psnr_and_ssim))
        trained: dict[Name, Callable[[], Perceptual]] = {"lpips": perceptual.lpips, "dists": perceptual.dists}
        for name, load in trained.items():
            if name in names:
                try:
                    found.single.append(Meter((name,), distance(load(), device)))
                except MetricUnavailable as error:
                    found.unavailable.append(str(error))
        if set(VIDEO) & set(names):
            try:
                vmaf.ffmpeg()
                found.video = True
            except MetricUnavailable as error:
                found.unavailable.append(str(error))
        return found


def distance(model: Perceptual, device: str) -> Measure:
    """Measurement with a model on a device. Raises StartError if the device is unavailable."""
    import torch

    try:
        model = model.to(device).eval()
    except (RuntimeError, AssertionError) as error:
        raise StartError(f"The device {device!r} cannot be used: {str(error).splitlines()[0]}") from None

    def measure(pictures: Sequence[Picture], truth: Picture) -> list[tuple[float, ...]]:
        if len(pictures) > 1 and truth.shape[0] * truth.shape[1] > MAX_BATCH_PIXELS:
            return [measure([picture], truth)[0] for picture in pictures]
        try:
            with torch.inference_mode(), torch.backends.cudnn.flags(allow_tf32=False):
                batch = torch.from_numpy(np.stack((truth, *pictures))).to(device).permute(0, 3, 1, 2).float() / 255
                return [(value,) for value in model(batch[1:], batch[:1]).tolist()]
        except torch.OutOfMemoryError:
            size = f"{truth.shape[1]}×{truth.shape[0]}"
            raise StartError(
                f"The GPU's memory is too small for pictures of {size}: hide it with CUDA_VISIBLE_DEVICES=."
            ) from None

    return measure


def _psnr_and_ssim(pictures: Sequence[Picture], truth: Picture) -> list[tuple[float, ...]]:
    found = [compare(picture, truth) for picture in pictures]
    return [(quality.psnr_db, quality.ssim) for quality in found]
