"""Packs a scene for the GPU, with neighbours in space next to each other, and coarser levels for large scenes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import torch

from tigas_render.gaussians import Batches
from tigas_render.raster.base import ALPHA_MIN, BASIS_CONSTANTS
from tigas_render.raster.cuda.levels import DEVIATION, PARENT, add_levels, level_sizes
from tigas_render.raster.cuda.scene import CHUNK, CudaScene, Grid, ScaleCodes

AT_ONCE = 1 << 22
"""Number of Gaussians processed together, in whole chunks, which bounds the memory of intermediate results."""


def pack(scene: Batches, device: torch.device) -> CudaScene:
    """Pack a scene on a device. A large scene has coarser levels after the full detail.

    Gaussians that are too transparent to be drawn or not finite are left out.
    """
    packed, sizes, grid = _pack_full_detail(scene, device)
    if grid is not None:
        add_levels(packed, sizes, grid, scene.check)
    return packed


def _pack_full_detail(scene: Batches, device: torch.device) -> tuple[CudaScene, list[int], Grid | None]:
    """The scene with room for coarser levels, the sizes of all levels in chunks, and the grid of the Z-order, or None
    for an empty scene.
    """
    whole, antialiased = _on_device(scene, device)
    keep, grid = _in_order(*whole[:4])
    means, scales, quaternions, opacities, sh = whole
    sh = sh[:, : coefficients_in_use(sh)]
    leaves = max(1, -(-len(keep) // CHUNK))
    sizes = level_sizes(leaves, len(keep))
    rows = sum(sizes) * CHUNK

    ends = [_log2(scales[keep[piece]]).aminmax() for piece in _pieces(len(keep))]
    low, high = min((float(end.min) for end in ends), default=0.0), max((float(end.max) for end in ends), default=0.0)
    if grid is not None and len(sizes) > 1:  # merged Gaussians become as large as the grid
        high = max(high, math.log2(2 / grid.scale))
    packed = CudaScene(
        means=torch.zeros(3, rows, device=device),
        shapes=torch.zeros(rows, 8, dtype=torch.int16, device=device),
        sh=torch.zeros(-(-sh.shape[1] * 3 // 4), rows, 4, dtype=torch.float16, device=device),
        bounds=torch.zeros(sum(sizes), 8, device=device),
        coefficients=sh.shape[1],
        scale_codes=ScaleCodes.spanning(low, high),
        antialiased=antialiased,
    )
    packed.bounds.view(torch.int32)[:, PARENT] = -1
    for slots in _pieces(len(keep)):
        some, chunks = keep[slots], slice(slots.start // CHUNK, -(-slots.stop // CHUNK))
        packed.means[:, slots] = means[some].T
        packed.shapes[slots] = packed.scale_codes.shapes(_log2(scales[some]), opacities[some], quaternions[some])
        packed.sh[:, slots] = _pack_sh(sh[some])
        packed.bounds[chunks, : DEVIATION + 1] = _bounds(means[some], scales[some])
    return packed, sizes, grid


def _pieces(count: int) -> Iterator[slice]:
    return (slice(first, min(first + AT_ONCE, count)) for first in range(0, count, AT_ONCE))


def _log2(scales: torch.Tensor) -> torch.Tensor:
    return scales.clamp_min(1e-30).log2()


def _in_order(
    means: torch.Tensor, scales: torch.Tensor, quaternions: torch.Tensor, opacities: torch.Tensor
) -> tuple[torch.Tensor, Grid | None]:
    """Indices of the drawable Gaussians in the Z-order of a grid, and the grid."""
    keep = opacities >= ALPHA_MIN
    for piece in _pieces(len(keep)):
        keep[piece] &= torch.cat([means[piece], scales[piece], quaternions[piece]], 1).isfinite().all(1)
    kept = keep.nonzero().squeeze(1)
    if not len(kept):
        return kept, None
    grid = Grid.of(means[kept])
    codes = torch.cat([grid.codes(means[kept[piece]]) for piece in _pieces(len(kept))])
    return kept[codes.argsort(stable=True)], grid


def _on_device(scene: Batches, device: torch.device) -> tuple[list[torch.Tensor], bool]:
    """Copy a scene to the device, with only one batch at a time on the host: means, scales, quaternions, opacities, and
    coefficients in half precision. Also returns whether the scene was trained antialiased.
    """
    first = next(scene.parts)
    whole = [
        torch.empty(
            scene.most, *each.shape[1:], dtype=torch.float16 if each is first.sh else torch.float32, device=device
        )
        for each in first.arrays
    ]
    count = 0
    for part in itertools.chain((first,), scene.parts):
        for tensor, rows in zip(whole, part.arrays, strict=True):
            tensor[count : count + len(rows)] = torch.from_numpy(rows).to(device)
        count += len(part)
    return [tensor[:count] for tensor in whole], first.antialiased


def coefficients_in_use(sh: torch.Tensor) -> int:
    """(degree + 1)² for the highest degree with a coefficient other than zero. sh: [N, K, 3]."""
    for degree in (3, 2, 1):
        first, end = degree**2, (degree + 1) ** 2
        if sh.shape[1] >= end and bool(sh[:, first:end].any()):
            return end
    return 1


def _pack_sh(sh: torch.Tensor) -> torch.Tensor:
    """Pack sh [N, K, 3] as float16 [groups, N, 4]. Values out of range are clamped."""
    numbers = sh.shape[1] * 3
    constants = torch.tensor(BASIS_CONSTANTS[: sh.shape[1]], device=sh.device)[:, None]
    packed = torch.zeros(len(sh), -(-numbers // 4) * 4, dtype=torch.float16, device=sh.device)
    packed[:, :numbers] = (sh.float() * constants).nan_to_num().clamp(-6e4, 6e4).reshape(-1, numbers)
    return packed.reshape(len(sh), -1, 4).transpose(0, 1)


def _bounds(means: torch.Tensor, scales: torch.Tensor) -> torch.Tensor:
    """float32 [chunks, 5]: centre, radius and largest deviation of N > 0 Gaussians in chunks, with a margin for
    rounding. The last chunk repeats its last Gaussian instead of padding.
    """
    last = torch.arange(-(-len(means) // CHUNK) * CHUNK, device=means.device).clamp_max(len(means) - 1)
    points = means[last].reshape(-1, CHUNK, 3)
    centres = 0.5 * (points.amin(1) + points.amax(1))
    radii = (points - centres[:, None]).norm(dim=2).amax(1) * 1.0001
    deviations = scales.amax(1)[last].reshape(-1, CHUNK).amax(1) * 1.001
    return torch.cat([centres, radii[:, None], deviations[:, None]], 1)
