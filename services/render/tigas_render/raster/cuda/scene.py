"""Packs a scene for the GPU: planar, 16 bits where they suffice, neighbours in space next to each other."""

from __future__ import annotations

import itertools
import struct
from dataclasses import dataclass, field

import torch

from tigas_render.gaussians import Batches
from tigas_render.raster.base import ALPHA_MIN, BASIS_CONSTANTS, PreparedScene
from tigas_render.raster.morton import BITS, MAX_SAMPLE, morton_grid, spread

CHUNK = 256
"""Gaussians that are culled together; `frame.cuh` says the same."""
POINTERS, CODES = struct.Struct("=4Q"), struct.Struct("=i2f")


@dataclass(frozen=True, slots=True)
class CudaScene(PreparedScene):
    """N Gaussians, padded to whole chunks with ones that are too transparent to be drawn."""

    means: torch.Tensor
    """float32 [3, N]."""
    shapes: torch.Tensor
    """int16 [N, 8]: three log2 scales as codes, opacity · 65535, quaternion w, x, y, z · 32767; all but the
    quaternion unsigned."""
    sh: torch.Tensor
    """float16 [groups, N, 4]: coefficients times their basis constants, coefficient-major, red, green, blue."""
    bounds: torch.Tensor
    """float32 [chunks, 8]: centre and radius of the means, then the greatest deviation."""
    coefficients: int
    """(degree + 1)², of the highest degree in use."""
    scale_low: float
    scale_step: float
    """log2 of a scale is scale_low + scale_step · code."""
    antialiased: bool = False
    """As Gaussians have it."""
    pointers: bytes = field(init=False)
    """Its part of the pointers in `struct Frame` of frame.cuh."""
    codes: bytes = field(init=False)
    """Its part of the numbers there: the coefficients, and the scales' codes."""

    def __post_init__(self) -> None:
        tensors = (self.means, self.shapes, self.sh, self.bounds)
        object.__setattr__(self, "pointers", POINTERS.pack(*(tensor.data_ptr() for tensor in tensors)))
        object.__setattr__(self, "codes", CODES.pack(self.coefficients, self.scale_low, self.scale_step))

    @property
    def padded(self) -> int:
        """Gaussians, padding included."""
        return self.means.shape[1]

    @property
    def nbytes(self) -> int:
        return sum(t.nbytes for t in (self.means, self.shapes, self.sh, self.bounds))


def pack(scene: Batches, device: torch.device) -> CudaScene:
    """Pack a scene on a device. Gaussians that are too transparent to be drawn or not finite are left out."""
    (means, scales, quaternions, opacities, sh), antialiased = _on_device(scene, device)
    sh = sh[:, : coefficients_in_use(sh)]
    finite = torch.cat([means, scales, quaternions], 1).isfinite().all(1) & (opacities >= ALPHA_MIN)
    keep = finite.nonzero().squeeze(1)
    keep = keep[torch.argsort(_morton_codes(means[keep]), stable=True)]
    padding = -len(keep) % CHUNK if len(keep) else CHUNK

    means = _padded(means[keep], padding)
    scales = scales[keep].clamp_min(1e-30)
    log_scales = scales.log2()
    low = float(log_scales.min()) if len(keep) else 0.0
    step = max((float(log_scales.max()) - low) / 65535, 1e-9) if len(keep) else 1.0
    unit = torch.nn.functional.normalize(quaternions[keep], dim=1)
    codes = torch.cat(
        [
            ((log_scales - low) / step).round().clamp(0, 65535),
            (opacities[keep, None].clamp(0, 1) * 65535).round(),
            (unit * 32767).round(),
        ],
        1,
    ).to(torch.int32)
    shapes = _padded(torch.where(codes > 32767, codes - 65536, codes).to(torch.int16), padding)
    return CudaScene(
        means=means.T.contiguous(),
        shapes=shapes.contiguous(),
        sh=_pack_sh(sh, keep, padding),
        bounds=_bounds(means[: len(keep)], scales, padding),
        coefficients=sh.shape[1],
        scale_low=low,
        scale_step=step,
        antialiased=antialiased,
    )


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


def _morton_codes(points: torch.Tensor) -> torch.Tensor:
    """The Z-order codes [N] of finite points [N, 3]; twin: `morton.morton_codes`."""
    codes = torch.zeros(len(points), dtype=torch.int64, device=points.device)
    if len(points):
        low, scale = morton_grid(points[:: max(1, len(points) // MAX_SAMPLE)].cpu().numpy())
        for axis in range(3):
            places = (points[:, axis].double() - float(low[axis])) * scale + 0.25
            codes |= spread((places.clamp(0, 1) * (2**BITS - 1)).long()) << axis
    return codes


def coefficients_in_use(sh: torch.Tensor) -> int:
    """(degree + 1)² of the highest degree that has a coefficient other than zero. sh: [N, K, 3]."""
    for degree in (3, 2, 1):
        first, end = degree**2, (degree + 1) ** 2
        if sh.shape[1] >= end and bool(sh[:, first:end].any()):
            return end
    return 1


def _padded(rows: torch.Tensor, padding: int) -> torch.Tensor:
    """`padding` rows of zeros more."""
    return torch.cat([rows, rows.new_zeros(padding, *rows.shape[1:])])


def _pack_sh(sh: torch.Tensor, keep: torch.Tensor, padding: int) -> torch.Tensor:
    """float16 [groups, N, 4]; values beyond half precision are clamped."""
    numbers = sh.shape[1] * 3
    constants = torch.tensor(BASIS_CONSTANTS[: sh.shape[1]], device=keep.device)
    packed = torch.zeros(-(-numbers // 4) * 4, len(keep) + padding, dtype=torch.float16, device=keep.device)
    for coefficient in range(sh.shape[1]):  # one at a time: the whole in float32 may not fit beside the rest
        values = sh[:, coefficient][keep].float() * constants[coefficient]
        packed[3 * coefficient : 3 * coefficient + 3, : len(keep)] = values.nan_to_num().clamp(-6e4, 6e4).T
    return packed.reshape(-1, 4, packed.shape[1]).transpose(1, 2).contiguous()


def _bounds(means: torch.Tensor, scales: torch.Tensor, padding: int) -> torch.Tensor:
    """float32 [chunks, 8], a little wide for rounding. The last chunk repeats its last Gaussian instead of padding."""
    if len(means) == 0:
        return torch.zeros(1, 8, device=means.device)
    last = torch.arange(len(means) + padding, device=means.device).clamp_max(len(means) - 1)
    points = means[last].reshape(-1, CHUNK, 3)
    centres = 0.5 * (points.amin(1) + points.amax(1))
    bounds = torch.zeros(len(points), 8, device=means.device)
    bounds[:, :3] = centres
    bounds[:, 3] = (points - centres[:, None]).norm(dim=2).amax(1) * 1.0001
    bounds[:, 4] = scales.amax(1)[last].reshape(-1, CHUNK).amax(1) * 1.001
    return bounds
