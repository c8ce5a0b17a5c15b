"""Gaussians as small discs with a normal, in double precision, as the start view needs them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_render.gaussians import Gaussians

Doubles = NDArray[np.float64]

FARTHEST = 1e8
"""Coordinates are clipped here: the protocol's end at 1e9, and the camera stands outside."""
SH_C0 = 0.28209479177387814
"""The constant spherical harmonic."""
SOLID = 0.3
"""Opacity from which on a Gaussian counts."""


@dataclass(frozen=True, slots=True)
class Surfels:
    """S solid Gaussians, in scene units."""

    centres: Doubles
    """[S, 3]"""
    normals: Doubles
    """[S, 3] axes of least extent, of length one and either sign."""
    extents: Doubles
    """[S, 3] standard deviations, ascending."""
    axes: Doubles
    """[S, 3, 3] columns: the axes of the extents."""
    opacities: Doubles
    """[S]"""
    lights: Doubles
    """[S] brightness, 0 to 1, without the part that depends on the direction of view."""

    def __len__(self) -> int:
        return len(self.centres)

    def every(self, most: int) -> Surfels:
        """At most this many, spread evenly."""
        step = -(-len(self) // most)
        return Surfels(*(array[::step] for array in self._arrays)) if step > 1 else self

    def turned(self, frame: Doubles) -> Surfels:
        """The same in a frame whose axes are the rows of a rotation [3, 3]."""
        centres, normals, axes = self.centres @ frame.T, self.normals @ frame.T, frame @ self.axes
        return Surfels(centres, normals, self.extents, axes, self.opacities, self.lights)

    @property
    def _arrays(self) -> tuple[Doubles, ...]:
        return self.centres, self.normals, self.extents, self.axes, self.opacities, self.lights


def surfels(gaussians: Gaussians) -> Surfels:
    """The solid Gaussians of a sample; of a scene without any, the most opaque ones."""
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
    """[S, 3, 3] rotations of quaternions w, x, y, z, of any length."""
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.where(lengths > 0, quaternions, (1.0, 0.0, 0.0, 0.0)) / np.where(lengths > 0, lengths, 1)
    w, x, y, z = unit.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, 1) for row in rows], 1)
