"""Packs a scene for the GPU: neighbours in space next to each other, a large scene with coarser levels."""

from __future__ import annotations

import itertools
import math

import torch

from tigas_render.gaussians import Batches
from tigas_render.raster.base import ALPHA_MIN, BASIS_CONSTANTS
from tigas_render.raster.cuda.levels import DEVIATION, PARENT, add_levels, level_sizes
from tigas_render.raster.cuda.scene import CHUNK, CudaScene, Grid, ScaleCodes


def pack(scene: Batches, device: torch.device) -> CudaScene:
    """Pack a scene on a device, a large one with coarser levels behind the full detail.

    Gaussians that are too transparent to be drawn or not finite are left out.
    """
    (means, scales, quaternions, opacities, sh), antialiased = _on_device(scene, device)
    sh = sh[:, : coefficients_in_use(sh)]
    finite = torch.cat([means, scales, quaternions], 1).isfinite().all(1) & (opacities >= ALPHA_MIN)
    keep = finite.nonzero().squeeze(1)
    grid = Grid.of(means[keep]) if len(keep) else None
    if grid is not None:
        keep = keep[torch.argsort(grid.codes(means[keep]), stable=True)]
    leaves = max(1, -(-len(keep) // CHUNK))
    sizes = level_sizes(leaves, len(keep))
    rows = sum(sizes) * CHUNK

    means, scales = means[keep], scales[keep].clamp_min(1e-30)
    log_scales = scales.log2()
    low, high = (float(log_scales.min()), float(log_scales.max())) if len(keep) else (0.0, 0.0)
    if grid is not None and len(sizes) > 1:  # Gaussians become as large as the grid when they are merged
        high = max(high, math.log2(2 / grid.scale))
    scale_codes = ScaleCodes.spanning(low, high)
    packed = CudaScene(
        means=torch.cat([means, means.new_zeros(rows - len(keep), 3)]).T.contiguous(),
        shapes=scale_codes.shapes(log_scales, opacities[keep], quaternions[keep], rows),
        sh=_pack_sh(sh, keep, rows),
        bounds=_bounds(means, scales, leaves, sum(sizes)),
        coefficients=sh.shape[1],
        scale_codes=scale_codes,
        antialiased=antialiased,
    )
    if grid is not None:
        add_levels(packed, sizes, grid, scene.check)
    return packed


def _on_device(scene: Batches, device: torch.device) -> tuple[list[torch.Tensor], bool]:
    """Means, scales, quaternions, opacities, and coefficients in half precision, and whether they were trained
    antialiased; the host holds a batch at a time.
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
    """(degree + 1)² of the highest degree that has a coefficient other than zero. sh: [N, K, 3]."""
    for degree in (3, 2, 1):
        first, end = degree**2, (degree + 1) ** 2
        if sh.shape[1] >= end and bool(sh[:, first:end].any()):
            return end
    return 1


def _pack_sh(sh: torch.Tensor, keep: torch.Tensor, rows: int) -> torch.Tensor:
    """float16 [groups, N, 4]; values beyond half precision are clamped."""
    numbers = sh.shape[1] * 3
    constants = torch.tensor(BASIS_CONSTANTS[: sh.shape[1]], device=keep.device)
    packed = torch.zeros(-(-numbers // 4) * 4, rows, dtype=torch.float16, device=keep.device)
    for coefficient in range(sh.shape[1]):  # one at a time: the whole in float32 may not fit into memory
        values = sh[:, coefficient][keep].float() * constants[coefficient]
        packed[3 * coefficient : 3 * coefficient + 3, : len(keep)] = values.nan_to_num().clamp(-6e4, 6e4).T
    return packed.reshape(-1, 4, packed.shape[1]).transpose(1, 2).contiguous()


def _bounds(means: torch.Tensor, scales: torch.Tensor, leaves: int, chunks: int) -> torch.Tensor:
    """float32 [chunks, 8] of the full detail, a little wide for rounding, and zeros for the other chunks. The last of
    the leaves repeats its last Gaussian instead of padding.
    """
    bounds = torch.zeros(chunks, 8, device=means.device)
    bounds.view(torch.int32)[:, PARENT] = -1
    if len(means) == 0:
        return bounds
    last = torch.arange(leaves * CHUNK, device=means.device).clamp_max(len(means) - 1)
    points = means[last].reshape(-1, CHUNK, 3)
    centres = 0.5 * (points.amin(1) + points.amax(1))
    bounds[:leaves, :3] = centres
    bounds[:leaves, 3] = (points - centres[:, None]).norm(dim=2).amax(1) * 1.0001
    bounds[:leaves, DEVIATION] = scales.amax(1)[last].reshape(-1, CHUNK).amax(1) * 1.001
    return bounds
