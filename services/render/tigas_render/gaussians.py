"""A scene's Gaussians, as every loader gives them and every rasteriser takes them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch


@dataclass(frozen=True, slots=True)
class Gaussians:
    """N Gaussians with activations applied; float32, contiguous, all on one device."""

    means: torch.Tensor
    """[N, 3] centres, in scene units."""
    scales: torch.Tensor
    """[N, 3] standard deviations along the Gaussian's own axes, in scene units."""
    quaternions: torch.Tensor
    """[N, 4] unit quaternions w, x, y, z: the Gaussian's own axes to the scene."""
    opacities: torch.Tensor
    """[N] in [0, 1]."""
    sh: torch.Tensor
    """[N, K, 3] spherical-harmonic coefficients of the colour, K = (degree + 1)²."""
    antialiased: bool = field(default=False, kw_only=True)
    """Whether they were trained with Mip-Splatting's 2D filter, and so have to be drawn with it."""

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def sh_degree(self) -> int:
        """0 to 3."""
        return math.isqrt(self.sh.shape[1]) - 1

    @property
    def nbytes(self) -> int:
        """Bytes that the tensors take."""
        return sum(t.nbytes for t in (self.means, self.scales, self.quaternions, self.opacities, self.sh))
