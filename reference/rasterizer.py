"""A short, readable PyTorch rasteriser, the baseline for the accuracy and speed of the others.

It matches gsplat 1.5.3. Sources of the formulas:

- [3DGS] Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023: blending, SH.
- [EWA] Zwicker et al., "EWA Splatting", 2002: the projected covariance J W Σ Wᵀ Jᵀ.
- [gsplat] Ye et al., "gsplat: An Open-Source Library for Gaussian Splatting", 2024: tangent clamping, stopping rules.

`base.footprint` describes the filters of a picture that is enlarged for display.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from tigas_common.pose import Intrinsics
from tigas_common.wire.render import FrameFormat
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.raster.base import (
    ALPHA_MAX,
    ALPHA_MIN,
    NEAR_PLANE,
    TRANSMITTANCE_MIN,
    Camera,
    Pause,
    PreparedScene,
    Rasterizer,
    depth_size,
    footprint,
    inverse_depth,
)
from tigas_render.raster.host_image import HostImage

TILE = 32
"""Pixels are blended in squares of this side, so that memory stays small."""
DEPTH_CHUNK = 256
"""Gaussians are blended this many at a time."""


@dataclass(frozen=True, slots=True)
class ReferenceScene(PreparedScene):
    """The unchanged arrays."""

    gaussians: Gaussians

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return self.gaussians.nbytes


class ReferenceRasterizer(Rasterizer):
    """Renders with plain tensor operations, in the depth order of the Gaussians' centres."""

    device = "reference"

    def pack(self, scene: Batches) -> ReferenceScene:
        """Keep the scene unchanged."""
        return ReferenceScene(scene.read_all())

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> HostImage:
        """Render one view, which takes seconds."""
        assert isinstance(scene, ReferenceScene)
        picture = render_float(scene.gaussians, camera)  # [H, W, 3]
        image = HostImage((picture.clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy())
        if depth:
            columns, rows = depth_size(image.width, image.height)
            means = average(average(depth_float(scene.gaussians, camera), rows).mT, columns).mT  # [2, h, w]
            image.depth = inverse_depth(means.permute(1, 2, 0).cpu().numpy())
        return image


@dataclass(frozen=True, slots=True)
class _Splats:
    """M projected Gaussians, nearest first."""

    centres: torch.Tensor  # [M, 2] pixels
    conics: torch.Tensor  # [M, 3] a, b, c of the inverse covariance [[a, b], [b, c]]
    extents: torch.Tensor  # [M, 2] pixels from the centre beyond which alpha < ALPHA_MIN
    colours: torch.Tensor  # [M, 3]
    opacities: torch.Tensor  # [M]
    depths: torch.Tensor  # [M]


def render_float(gaussians: Gaussians, camera: Camera, device: str = "cpu") -> torch.Tensor:
    """The picture before rounding, float32 [H, W, 3], made on PyTorch's `device`."""
    splats = _project(gaussians, camera, device)
    background = torch.tensor(camera.background, dtype=torch.float32, device=device)
    return _draw(splats, splats.colours, background, camera.intrinsics)


def depth_float(gaussians: Gaussians, camera: Camera, device: str = "cpu") -> torch.Tensor:
    """Sum of the Gaussians' weights at each pixel, float32 [2, H, W]: divided by z, and alone."""
    splats = _project(gaussians, camera, device)
    values = torch.stack([1 / splats.depths, torch.ones_like(splats.depths)], 1)
    return _draw(splats, values, values.new_zeros(2), camera.intrinsics).permute(2, 0, 1)


def average(values: torch.Tensor, rows: int) -> torch.Tensor:
    """Values [..., H, W] averaged over rows that are as high as H / rows each: [..., rows, W]."""
    edges = torch.arange(values.shape[-2] + 1, device=values.device)
    ends = torch.arange(rows + 1, device=values.device) * (values.shape[-2] / rows)
    overlap = torch.minimum(ends[1:, None], edges[1:]) - torch.maximum(ends[:-1, None], edges[:-1])
    weights = overlap.clamp_min(0)
    return (weights / weights.sum(1, keepdim=True)).to(values.dtype) @ values


def _draw(splats: _Splats, values: torch.Tensor, background: torch.Tensor, intrinsics: Intrinsics) -> torch.Tensor:
    """Blend the splats' values [M, C]: [H, W, C]."""
    device = values.device
    picture = torch.empty(intrinsics.height, intrinsics.width, values.shape[1], device=device)
    low, high = splats.centres - splats.extents, splats.centres + splats.extents
    for y in range(0, intrinsics.height, TILE):
        in_rows = (low[:, 1] < y + TILE) & (high[:, 1] > y)
        for x in range(0, intrinsics.width, TILE):
            near = torch.nonzero(in_rows & (low[:, 0] < x + TILE) & (high[:, 0] > x)).squeeze(1)
            tile = picture[y : y + TILE, x : x + TILE]
            rows = torch.arange(y, y + tile.shape[0], device=device) + 0.5
            columns = torch.arange(x, x + tile.shape[1], device=device) + 0.5
            pixels = torch.cartesian_prod(rows, columns).flip(1)  # [P, 2] x, y
            tile[:] = _blend(splats, values, near, pixels, background).reshape(tile.shape)
    return picture


def _project(gaussians: Gaussians, camera: Camera, device: str) -> _Splats:
    """EWA projection; drops invisible Gaussians and sorts the rest by depth."""
    k = camera.intrinsics
    means, scales, quaternions, opacities, sh = (torch.from_numpy(array).to(device) for array in gaussians.arrays)
    rotation = torch.tensor(camera.pose.rotation, dtype=torch.float32, device=device).T  # world to camera
    from_camera = means - torch.tensor(camera.pose.position, dtype=torch.float32, device=device)  # [N, 3]
    points = from_camera @ rotation.T
    keep = torch.nonzero((points[:, 2] >= NEAR_PLANE) & (opacities >= ALPHA_MIN)).squeeze(1)
    keep = keep[torch.argsort(points[keep, 2], stable=True)]
    points = points[keep]

    x, y, z = points.unbind(1)
    axes = rotation_matrices(quaternions[keep]) * scales[keep, None, :]
    jacobian = _jacobian(points, camera.viewport)  # [M, 2, 3]
    half = jacobian @ rotation @ axes  # [M, 2, 3]: a square root of the projected covariance
    covariance = half @ half.mT
    dilation, low_pass = footprint(camera.display_scale, gaussians.antialiased)
    opacities = opacities[keep] * _compensation(covariance, dilation, low_pass)
    covariance = covariance + (dilation + low_pass) * torch.eye(2, device=device)
    cxx, cxy, cyy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    determinant = cxx * cyy - cxy * cxy
    reach = torch.sqrt(2 * torch.log(opacities / ALPHA_MIN))  # alpha falls below ALPHA_MIN at this many deviations
    splats = _Splats(
        centres=torch.stack([k.fx * x / z + k.cx, k.fy * y / z + k.cy], 1),
        conics=torch.stack([cyy, -cxy, cxx], 1) / determinant[:, None],
        extents=reach[:, None] * torch.stack([cxx, cyy], 1).sqrt(),
        colours=colours(sh[keep], torch.nn.functional.normalize(from_camera[keep], dim=1)),
        opacities=opacities,
        depths=z,
    )
    numbers = torch.cat([splats.centres, splats.conics, splats.extents], 1)
    ok = (determinant > 0) & (opacities >= ALPHA_MIN) & numbers.isfinite().all(1)
    return _Splats(
        splats.centres[ok], splats.conics[ok], splats.extents[ok], splats.colours[ok], splats.opacities[ok],
        splats.depths[ok],
    )  # fmt: skip


def _compensation(covariance: torch.Tensor, dilation: float, low_pass: float) -> torch.Tensor:
    """[M]: the factor of opacity that preserves a Gaussian's coverage when its covariance [M, 2, 2] is filtered.

    det(Σ + c I) = det Σ + c tr Σ + c² does not cancel where Σ is thin; det Σ itself is nearly 0 there, but never
    less.
    """
    cxx, cxy, cyy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    determinant, trace = (cxx * cyy - cxy * cxy).clamp_min(0), cxx + cyy
    before, after = (determinant + c * (trace + c) for c in (dilation, dilation + low_pass))
    return (before / after).sqrt()


def _jacobian(points: torch.Tensor, k: Intrinsics) -> torch.Tensor:
    """[M, 2, 3]: the derivative of the perspective projection [EWA], with x/z and y/z clamped as in [gsplat].

    The limits lie 0.3 half-widths of a centred viewport outside the viewport's own edges.
    """
    x, y, z = points.unbind(1)
    margin_x, margin_y = 0.3 * 0.5 * k.width / k.fx, 0.3 * 0.5 * k.height / k.fy
    tx = (x / z).clamp(-k.cx / k.fx - margin_x, (k.width - k.cx) / k.fx + margin_x)
    ty = (y / z).clamp(-k.cy / k.fy - margin_y, (k.height - k.cy) / k.fy + margin_y)
    zero = torch.zeros_like(z)
    return torch.stack([k.fx / z, zero, -k.fx * tx / z, zero, k.fy / z, -k.fy * ty / z], 1).reshape(-1, 2, 3)


def rotation_matrices(quaternions: torch.Tensor) -> torch.Tensor:
    """[M, 3, 3] from unit quaternions [M, 4] w, x, y, z."""
    w, x, y, z = quaternions.unbind(1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, 1) for row in rows], 1)


def colours(sh: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
    """[M, 3] colours seen along unit directions [M, 3] from the camera; basis and signs of [3DGS].

    sh: [M, K, 3] coefficients.
    """
    basis = sh_basis(directions, sh.shape[1])  # [M, K]
    return (torch.einsum("mk,mkc->mc", basis, sh) + 0.5).clamp_min(0)


def sh_basis(directions: torch.Tensor, count: int) -> torch.Tensor:
    """[M, count] real spherical harmonics for unit directions [M, 3]; count = (degree + 1)², degree 0 to 3 [3DGS]."""
    x, y, z = directions.unbind(1)
    xx, yy, zz, xy, yz, xz = x * x, y * y, z * z, x * y, y * z, x * z
    functions = [
        0.28209479177387814 * torch.ones_like(x),
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * xy,
        -1.0925484305920792 * yz,
        0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * xz,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * xy * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    return torch.stack(functions[:count], 1)


def _blend(
    splats: _Splats, values: torch.Tensor, near: torch.Tensor, pixels: torch.Tensor, background: torch.Tensor
) -> torch.Tensor:
    """Front to back over `near` (indices, nearest first): [P, C] values of pixel centres [P, 2].

    A Gaussian that would leave a transmittance of TRANSMITTANCE_MIN or less is not drawn and ends its pixel [gsplat].
    """
    colour = torch.zeros(len(pixels), values.shape[1], device=pixels.device)
    light = torch.ones(len(pixels), device=pixels.device)  # transmittance so far
    alive = torch.ones(len(pixels), dtype=torch.bool, device=pixels.device)
    for first in range(0, len(near), DEPTH_CHUNK):
        some = near[first : first + DEPTH_CHUNK]
        dx, dy = (pixels[:, None, :] - splats.centres[some]).unbind(2)  # [P, C]
        a, b, c = splats.conics[some].unbind(1)
        sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        alpha = (splats.opacities[some] * torch.exp(-sigma)).clamp_max(ALPHA_MAX)
        alpha = torch.where((alpha >= ALPHA_MIN) & (sigma >= 0), alpha, 0.0)
        after = light[:, None] * torch.cumprod(1 - alpha, 1)  # transmittance behind each Gaussian
        drawn = alive[:, None] & (after > TRANSMITTANCE_MIN)
        before = torch.cat([light[:, None], after[:, :-1]], 1)
        colour += torch.where(drawn, alpha * before, 0.0) @ values[some]
        light = torch.where(drawn, after, light[:, None]).amin(1)
        alive &= drawn[:, -1]
        if not alive.any():
            break
    return colour + light[:, None] * background
