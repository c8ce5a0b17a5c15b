"""The requested metrics with their requirements: weights, a device, and ffmpeg. Unavailable metrics are left out, with
a sentence each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch

from tigas_common.errors import StartError
from tigas_experiments.quality import weights
from tigas_experiments.quality.metrics import Name
from tigas_experiments.quality.perceptual import Perceptual
from tigas_experiments.quality.picture import Picture, compare
from tigas_experiments.quality.vmaf import NoVmaf, ffmpeg
from tigas_experiments.quality.weights import NoWeights

MOST_TOGETHER = 2_000_000
"""Pixels of a picture; larger ones are compared one at a time: DISTS takes 1.6 GB for each megapixel of a pair."""
VIDEO: tuple[Name, ...] = ("vmaf", "vif")
"""Metrics of a sequence of pictures."""


@dataclass(frozen=True, slots=True)
class Meter:
    """Computes metrics of single pictures."""

    names: tuple[Name, ...]
    measure: Callable[[Sequence[Picture], Picture], list[tuple[float, ...]]]
    """Values of `names` for each picture, against one ground truth of the same size."""


@dataclass(slots=True)
class Meters:
    """The requested metrics that are available."""

    single: list[Meter] = field(default_factory=list)
    video: bool = False
    """Whether VMAF and VIFp are."""
    left_out: list[str] = field(default_factory=list)
    """A sentence for each thing that is not here."""

    @classmethod
    def of(cls, names: Sequence[Name], device: str) -> Meters:
        """Raises StartError if there is no such device."""
        found = cls()
        if {"psnr", "ssim"} & set(names):
            found.single.append(Meter(("psnr", "ssim"), _psnr_and_ssim))
        trained: dict[Name, Callable[[], Perceptual]] = {"lpips": weights.lpips, "dists": weights.dists}
        for name, load in trained.items():
            if name in names:
                try:
                    found.single.append(Meter((name,), distance(load(), device)))
                except NoWeights as error:
                    found.left_out.append(str(error))
        if set(VIDEO) & set(names):
            try:
                ffmpeg()
                found.video = True
            except NoVmaf as error:
                found.left_out.append(str(error))
        return found


def distance(model: Perceptual, device: str) -> Callable[[Sequence[Picture], Picture], list[tuple[float, ...]]]:
    """A measurement with a model on a device. Raises StartError if the device is unavailable."""
    try:
        model = model.to(device).eval()
    except (RuntimeError, AssertionError) as error:
        raise StartError(f"The device {device!r} cannot be used: {str(error).splitlines()[0]}") from None

    def measure(pictures: Sequence[Picture], truth: Picture) -> list[tuple[float, ...]]:
        if len(pictures) > 1 and truth.shape[0] * truth.shape[1] > MOST_TOGETHER:
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
