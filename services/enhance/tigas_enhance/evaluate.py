"""Quality gain of enhanced views over bicubic enlargement, on held-out views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from tigas_enhance.network import Network, enhance, resample
from tigas_enhance.pairs import Pair
from tigas_enhance.renderer import Pixels

RESAMPLES = 2000
"""Bootstrap resamples."""


@dataclass(frozen=True, slots=True)
class Scores:
    """PSNR in dB and SSIM of N views, over all pixels except the background."""

    psnr: NDArray[np.float64]  # [N]
    ssim: NDArray[np.float64]  # [N]


@torch.no_grad()
def compute_scores(pairs: Sequence[Pair], rung: int, network: Network | None, device: torch.device) -> Scores:
    """Scores of a rung's frames at display size: enhanced or, without a network, enlarged bicubically."""
    network = network and network.to(device)
    psnr, ssim = [], []
    for pair in pairs:
        height, width = pair.content.shape
        low, truth = _to_batch(pair.rungs[rung], device), _to_batch(pair.full, device)
        outcome = resample(low, width, height).clamp(0, 1) if network is None else enhance(network, low, width, height)
        outcome = (outcome * 255).round() / 255
        content = torch.from_numpy(pair.content).to(device)
        error = (outcome - truth)[0, :, content].square().mean().clamp_min(1e-10)
        psnr.append(-10 * float(error.log10()))
        ssim.append(float(_ssim_map(outcome, truth)[0, 0][content].mean()))
    return Scores(np.array(psnr), np.array(ssim))


def psnr_gains(pairs: Sequence[Pair], rung: int, network: Network, device: torch.device) -> NDArray[np.float64]:
    """Gain in PSNR over bicubic enlargement, in dB, for each view [N]."""
    return compute_scores(pairs, rung, network, device).psnr - compute_scores(pairs, rung, None, device).psnr


def confidence_interval(gains: NDArray[np.float64]) -> tuple[float, float]:
    """95 % confidence interval of the mean of gains [N], bootstrapped over views."""
    random = np.random.default_rng(0)
    means = gains[random.integers(len(gains), size=(RESAMPLES, len(gains)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def _to_batch(pixels: Pixels, device: torch.device) -> Tensor:
    return torch.from_numpy(pixels.copy()).to(device).permute(2, 0, 1)[None].float() / 255


def _ssim_map(a: Tensor, b: Tensor) -> Tensor:
    """SSIM map [B, 1, H, W] of luma, with a Gaussian window of 11 pixels and σ = 1.5 (Wang et al., TIP 13, 2004)."""
    at = torch.arange(-5, 6, device=a.device) / 1.5
    line = torch.exp(-at.square() / 2)
    line = line / line.sum()
    luma = torch.tensor([0.299, 0.587, 0.114], device=a.device).view(1, 3, 1, 1)
    a, b = (a * luma).sum(1, keepdim=True), (b * luma).sum(1, keepdim=True)
    both = torch.cat((a, b, a * a, b * b, a * b))
    both = functional.conv2d(functional.pad(both, (5, 5, 5, 5), mode="reflect"), line.view(1, 1, 1, 11))
    mean_a, mean_b, aa, bb, ab = functional.conv2d(both, line.view(1, 1, 11, 1)).chunk(5)
    spread_a, spread_b, together = aa - mean_a**2, bb - mean_b**2, ab - mean_a * mean_b
    similarity: Tensor = ((2 * mean_a * mean_b + 1e-4) * (2 * together + 9e-4)) / (
        (mean_a**2 + mean_b**2 + 1e-4) * (spread_a + spread_b + 9e-4)
    )
    return similarity
