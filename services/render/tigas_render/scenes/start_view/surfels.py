"""Gaussians as small discs with normals, in double precision, for the start view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_render.gaussians import Gaussians

Doubles = NDArray[np.float64]

FARTHEST = 1e8
"""Coordinates are clipped to this value, since the protocol's limit is 1e9 and the camera may be outside the scene."""
SH_C0 = 0.28209479177387814
"""The constant spherical harmonic."""
SOLID = 0.3
"""Minimum opacity of a solid Gaussian."""


@dataclass(frozen=True, slots=True)
class Surfels:
    """S solid Gaussians, in scene units."""

    centres: Doubles
    """[S, 3]"""
    normals: Doubles
    """[S, 3] unit axes of smallest extent, with either sign."""
    extents: Doubles
    """[S, 3] standard deviations, ascending."""
    axes: Doubles
    """[S, 3, 3] axes of the extents, in columns."""
    opacities: Doubles
    """[S]"""
    lights: Doubles
    """[S] brightness, 0 to 1, without its view-dependent part."""

    def __len__(self) -> int:
        return len(self.centres)

    def subsample(self, most: int) -> Surfels:
        """At most this many surfels, evenly spaced."""
        step = -(-len(self) // most)
        return Surfels(*(array[::step] for array in self._arrays)) if step > 1 else self

    def rotated(self, frame: Doubles) -> Surfels:
        """The surfels in another frame, with the rows of a rotation matrix [3, 3] as its axes."""
        centres, normals, axes = self.centres @ frame.T, self.normals @ frame.T, frame @ self.axes
        return Surfels(centres, normals, self.extents, axes, self.opacities, self.lights)

    @property
    def _arrays(self) -> tuple[Doubles, ...]:
        return self.centres, self.normals, self.extents, self.axes, self.opacities, self.lights


def surfels(gaussians: Gaussians) -> Surfels:
    """The solid Gaussians of a sample, or the most opaque ones if no Gaussian is solid."""
    solid = gaussians.opacities >= min(SOLID, float(gaussians.opacities.max()))
    scales = gaussians.scales[solid].astype(np.float64).clip(0, FARTHEST)
    order = np.argsort(scales, axis=1, kind="stable")
    axes = np.take_along_axis(_rotations(gaussians.quaternions[solid].astype(np.float64)), order[:, None, :], 2)
    return Surfels(
        gaussians.means[solid].astype(np.float64).clip(-FARTHEST, FARTHEST),
        axes[:, :, 0],
        np.take_along_axis(scales, order, 1),
        axes,
        gaussians.opacities[solid].astype(np.float64),
        (0.5 + SH_C0 * gaussians.sh[solid, 0].astype(np.float64).mean(1)).clip(0, 1),
    )


def _rotations(quaternions: Doubles) -> Doubles:
    """[S, 3, 3] rotation matrices of quaternions w, x, y, z of any length."""
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.where(lengths > 0, quaternions, (1.0, 0.0, 0.0, 0.0)) / np.where(lengths > 0, lengths, 1)
    w, x, y, z = unit.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, 1) for row in rows], 1)
