"""A packed scene on the device: planar, with 16 bits where they suffice, and neighbours in space next to each other."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from tigas_render.raster.base import PreparedScene
from tigas_render.raster.morton import BITS, MAX_SAMPLE, morton_grid, spread

CHUNK = 256
"""Number of Gaussians that are culled together, as in `frame.cuh`."""
POINTERS, CODES = struct.Struct("=4Q"), struct.Struct("=i2f")
CELLS = (1 << BITS) - 1
"""Number of cells per axis, not counting the border's."""


class Grid(NamedTuple):
    """The cells of the Z-order; see `morton.morton_grid`."""

    low: NDArray[np.float64]
    scale: float

    @classmethod
    def of(cls, points: torch.Tensor) -> Grid:
        """The grid of points [N, 3], N > 0."""
        low, scale = morton_grid(points[:: max(1, len(points) // MAX_SAMPLE)].cpu().numpy())
        return cls(low, float(scale))

    @property
    def cell(self) -> float:
        """The length of a cell's edge, in scene units."""
        return 1 / (self.scale * CELLS)

    def places(self, points: torch.Tensor) -> torch.Tensor:
        """Positions of points [N, 3] in the grid, float64 [N, 3]: 0 to 1 inside."""
        return (points.double() - torch.from_numpy(self.low).to(points.device)) * self.scale + 0.25

    def codes(self, points: torch.Tensor) -> torch.Tensor:
        """The Z-order codes [N] of finite points [N, 3], equal to those of `morton.morton_codes`."""
        cells = (self.places(points).clamp_(0, 1) * CELLS).long()
        codes: torch.Tensor = spread(cells[:, 0]) | spread(cells[:, 1]) << 1 | spread(cells[:, 2]) << 2
        return codes


class ScaleCodes(NamedTuple):
    """The encoding of scales: log2(scale) = low + step · code."""

    low: float
    step: float

    @classmethod
    def spanning(cls, low: float, high: float) -> ScaleCodes:
        """The codes for logarithms from `low` to `high`."""
        return cls(low, max((high - low) / 65535, 1e-9))

    def shapes(self, log_scales: torch.Tensor, opacities: torch.Tensor, quaternions: torch.Tensor) -> torch.Tensor:
        """Encode Gaussians as `CudaScene.shapes` [N, 8]. log_scales: log2 of the scales."""
        shapes = torch.empty(len(log_scales), 8, dtype=torch.int16, device=log_scales.device)
        unit = torch.nn.functional.normalize(quaternions, dim=1)
        for fields, values in (
            (slice(0, 3), ((log_scales - self.low) / self.step).clamp(0, 65535)),
            (slice(3, 4), opacities[:, None].clamp(0, 1) * 65535),
            (slice(4, 8), unit * 32767),
        ):
            codes = values.round().to(torch.int32)
            shapes[:, fields] = torch.where(codes > 32767, codes - 65536, codes).to(torch.int16)
        return shapes

    def scales(self, shapes: torch.Tensor) -> torch.Tensor:
        """Scales, float64 [..., 3], from shapes [..., 8]."""
        return torch.exp2(self.low + self.step * (shapes[..., :3].to(torch.int32) & 0xFFFF).double())


def opacities(shapes: torch.Tensor) -> torch.Tensor:
    """Opacities, float64 [N], from shapes [N, 8]."""
    return (shapes[:, 3].to(torch.int32) & 0xFFFF).double() / 65535


@dataclass(frozen=True, slots=True)
class CudaScene(PreparedScene):
    """N Gaussians, including padding to whole chunks with ones that are too transparent to be drawn."""

    means: torch.Tensor
    """float32 [3, N]."""
    shapes: torch.Tensor
    """int16 [N, 8]: three log2 scales as codes, opacity · 65535, and quaternion w, x, y, z · 32767. All but the
    quaternion are unsigned."""
    sh: torch.Tensor
    """float16 [groups, N, 4]: coefficients times their basis constants, coefficient-major, red, green, blue."""
    bounds: torch.Tensor
    """float32 [chunks, 8]: centre and radius of the means, or of a sphere around a coarser chunk's descendants; the
    largest deviation; a cell's edge, 0 for the full detail; the parent's number as an int32, -1 without a parent."""
    coefficients: int
    """(degree + 1)² for the highest degree in use."""
    scale_codes: ScaleCodes
    antialiased: bool = False
    """Whether the scene was trained with Mip-Splatting's 2D filter."""
    pointers: bytes = field(init=False)
    """The scene's pointers in `struct Frame` of frame.cuh."""
    codes: bytes = field(init=False)
    """The scene's numbers in `struct Frame`: the number of coefficients, and the scale codes."""

    def __post_init__(self) -> None:
        tensors = (self.means, self.shapes, self.sh, self.bounds)
        object.__setattr__(self, "pointers", POINTERS.pack(*(tensor.data_ptr() for tensor in tensors)))
        object.__setattr__(self, "codes", CODES.pack(self.coefficients, *self.scale_codes))

    @property
    def padded(self) -> int:
        """Number of Gaussians, including padding."""
        return self.means.shape[1]

    @property
    def nbytes(self) -> int:
        return sum(t.nbytes for t in (self.means, self.shapes, self.sh, self.bounds))
