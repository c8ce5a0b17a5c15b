"""In which order Gaussians are downloaded: first those that cover most of the picture that a visitor sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.model import Point
from tigas_render.gaussians import Gaussians


def by_importance(gaussians: Gaussians, viewpoint: Point) -> NDArray[np.int64]:
    """The Gaussians' indices [N], the most important first.

    Importance is opacity × area / squared distance, which is how much of the picture a Gaussian covers. Viewers walk,
    so nothing counts as nearer to `viewpoint` than half of all Gaussians are.
    """
    means = gaussians.means.cpu().numpy().astype(np.float64)
    scales = np.sort(gaussians.scales.cpu().numpy().astype(np.float64), axis=1)
    squared = ((means - viewpoint) ** 2).sum(1)
    area = scales[:, 2] * scales[:, 1]
    near = max(float(np.median(squared)), np.finfo(np.float64).tiny)
    importance = gaussians.opacities.cpu().numpy() * area / np.maximum(squared, near)
    return np.argsort(-importance, kind="stable")
