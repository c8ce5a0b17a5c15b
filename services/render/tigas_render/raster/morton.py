"""Z-order: neighbours in space become neighbours in memory."""

from __future__ import annotations

import torch

BITS = 20
"""Of each axis; three axes fill 60 of 64."""
MAX_SAMPLE = 100_000
"""Points, about, that the grid's extent is estimated from."""


def morton_codes(points: torch.Tensor) -> torch.Tensor:
    """The Z-order codes int64 [N] of points [N, 3].

    The grid spans the middle 98 % of each axis, so that a few points far away do not make it coarse.
    """
    if len(points) == 0:
        return torch.zeros(0, dtype=torch.int64, device=points.device)
    low, scale = morton_grid(points)
    cells = (points - low) * scale + 0.25
    grid = (cells.nan_to_num().clamp(0, 1) * (2**BITS - 1)).to(torch.int64)
    codes = torch.zeros_like(grid[:, 0])
    for axis in range(3):
        codes |= _spread(grid[:, axis]) << axis
    return codes


def morton_grid(points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Where the grid of points [N, 3] lies: a point's place in it, 0 to 1, is (point - low) · scale + 1/4."""
    some = points[:: max(1, len(points) // MAX_SAMPLE)]
    low, high = torch.quantile(some, torch.tensor([0.01, 0.99], device=points.device), dim=0)
    return low, 0.5 / (high - low).max().clamp_min(1e-30)


def _spread(values: torch.Tensor) -> torch.Tensor:
    """Put two zero bits between the lowest BITS bits of each value."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        values = (values | (values << shift)) & mask
    return values
