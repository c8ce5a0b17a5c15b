"""The six metrics of a picture against ground truth: their names, variants and directions, for commands and reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tigas_experiments.quality.picture import MAX_PSNR_DB

Name = Literal["psnr", "ssim", "vmaf", "vif", "lpips", "dists"]


@dataclass(frozen=True, slots=True)
class PictureMetric:
    """One metric."""

    name: Name
    """Its field in scores.ndjson, and its name in commands and CSV files."""
    title: str
    variant: str
    """Exact definition and input."""
    unit: str
    digits: int
    better: Literal["high", "low"]

    @property
    def heading(self) -> str:
        """Title, unit and direction."""
        unit = f", {self.unit}" if self.unit else ""
        return f"{self.title}{unit} ({self.better}er is better)"


PSNR = PictureMetric("psnr", "PSNR", f"of 8-bit RGB, at most {MAX_PSNR_DB:g} dB", "dB", 1, "high")
SSIM = PictureMetric("ssim", "SSIM", "Wang et al. 2004, Gaussian weights, mean over R, G and B", "", 3, "high")
VMAF = PictureMetric("vmaf", "VMAF", "v0.6.1, on the samples of a run as a video, in their order", "", 1, "high")
VIF = PictureMetric("vif", "VIFp", "pixel domain, 4 scales, on luma (libvmaf's float_vif)", "", 3, "high")
LPIPS = PictureMetric("lpips", "LPIPS", "v0.1, AlexNet", "", 3, "low")
DISTS = PictureMetric("dists", "DISTS", "VGG16, at the picture's own size", "", 3, "low")
PICTURE_METRICS = (PSNR, SSIM, VMAF, VIF, LPIPS, DISTS)
