"""Gaussians from any array-like values."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tigas_render.gaussians import Gaussians


def gaussians_of(
    means: ArrayLike, scales: ArrayLike, quaternions: ArrayLike, opacities: ArrayLike, sh: ArrayLike
) -> Gaussians:
    """Gaussians, float32, where numbers that are too great are infinite; shapes as `Gaussians` has them."""
    arrays = (means, scales, quaternions, opacities, sh)
    with np.errstate(over="ignore"):
        return Gaussians(*(np.ascontiguousarray(array, np.float32) for array in arrays))
