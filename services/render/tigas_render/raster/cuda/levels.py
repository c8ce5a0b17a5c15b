"""Coarser levels of a large scene: a tree of chunks, built on the device.

Every four neighbouring chunks have a parent, a chunk in which the Gaussians in the same small cell of space are merged
into one. Parents have parents in turn, up to a single root. Cells are those of the Z-order, halved axis by axis, and as
small as a chunk has room for. Only Gaussians smaller than a cell are merged, so a chunk differs from the full detail by
at most a cell's edge. `begin.cu` draws each chunk with an edge that is short on screen, unless its parent's is as well.
Gaussians are merged as in `cpu.levels.merge`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import torch

from tigas_render.raster.base import ALPHA_MAX, DILATION
from tigas_render.raster.cuda.scene import CHUNK, CudaScene, Grid, opacities
from tigas_render.raster.morton import BITS

FROM = 1 << 20
"""Minimum number of Gaussians for a scene to have levels."""
FAN_OUT = 4
"""Number of chunks per parent."""
EDGE_PIXELS = 0.5
"""Maximum length of a cell's edge on screen. At 0.7, a walk through 108 million Gaussians had 44.5 dB, not 52.6."""
PARENTS_AT_ONCE = 2048
"""Number of parents filled together, from two million Gaussians with about a gigabyte of intermediate results."""
NEVER = math.inf
"""The edge of a parent without room for its children's Gaussians, which are then drawn at any distance."""
DEVIATION, EDGE, PARENT = 4, 5, 6
"""Fields of a chunk's bounds, after centre and radius, as in `begin.cu`."""
ROTATIONS = 5 * ((0, 1), (0, 2), (1, 2))
"""Pairs of axes to rotate: five sweeps diagonalise a 3 × 3 matrix to double precision."""
LEAST_AREA = 1e-60
"""Minimum area, so that the weights of Gaussians without any extent can be divided by their sum."""


def level_sizes(leaves: int, count: int) -> list[int]:
    """Number of chunks at each level, starting with the full detail, for `count` Gaussians in `leaves` chunks."""
    sizes = [leaves]
    while count >= FROM and sizes[-1] > 1:
        sizes.append(-(-sizes[-1] // FAN_OUT))
    return sizes


def add_levels(scene: CudaScene, sizes: list[int], grid: Grid, check: Callable[[], None]) -> None:
    """Write the coarser levels after the full detail.

    scene: with room for them, filled with zeros. sizes: from `level_sizes`. check: called regularly, and may raise an
    error to abort.
    """
    begins = list(itertools.accumulate(sizes, initial=0))
    shifts = torch.zeros(begins[-1], dtype=torch.int64, device=scene.means.device)
    for level in range(1, len(sizes)):
        for first in range(0, sizes[level], PARENTS_AT_ONCE):
            check()
            end = min(first + PARENTS_AT_ONCE, sizes[level])
            below = begins[level - 1]
            children = slice(below + FAN_OUT * first, min(below + FAN_OUT * end, begins[level]))
            _add_parents(scene, grid, shifts, children, slice(begins[level] + first, begins[level] + end))


def _add_parents(scene: CudaScene, grid: Grid, shifts: torch.Tensor, children: slice, parents: slice) -> None:
    """Fill the chunks `parents` from the chunks `children`. shifts: of all chunks' cells; -1 for no cells."""
    slots = scene.shapes[children.start * CHUNK : children.stop * CHUNK, 3].nonzero().squeeze(1)
    group = slots // (FAN_OUT * CHUNK)
    slots += children.start * CHUNK
    finer = Finer.unpacked(scene, slots, grid)
    least = _families(shifts[children], 0).amax(1).clamp_min(0)
    shift = shifts_for(CHUNK, group, finer.codes, finer.sizes, grid.cell, least)
    shifts[parents] = shift
    there = shift[group] >= 0
    slots, group, finer = slots[there], group[there], Finer(*(each[there] for each in finer))

    edge = edges(shift, grid.cell)
    member, first = _members(group, finer.codes >> shift[group], finer.sizes <= edge[group])
    lengths = _lengths(first)
    alone = torch.repeat_interleave(lengths == 1, lengths)
    emitted = torch.ones_like(there[: len(slots)])
    emitted[member] = first
    kept = emitted.clone()
    kept[member] = alone
    number = emitted.cumsum(0) - 1
    first_number = _at_groups(number, group, len(shift))
    into = (parents.start + group) * CHUNK + number - first_number[group]

    _copy(scene, slots[kept], into[kept])
    member, lengths, into = member[~alone], lengths[lengths > 1], into[member[first]][lengths > 1]
    blur = torch.zeros_like(edge) if scene.antialiased else DILATION * (edge / EDGE_PIXELS) ** 2
    _write_merged(scene, slots[member], Finer(*(each[member] for each in finer)), lengths, into, blur[group[member]])
    _bound(scene, children, parents, edge)


class Finer(NamedTuple):
    """N unpacked Gaussians of a finer level, in the order of their Z-order codes."""

    means: torch.Tensor
    """float64 [N, 3]."""
    covariances: torch.Tensor
    """float64 [N, 6]: xx, xy, xz, yy, yz, zz."""
    opacities: torch.Tensor
    """float64 [N]."""
    codes: torch.Tensor
    sizes: torch.Tensor
    """Upper bounds on the Gaussians' largest deviations; infinite outside the grid."""

    @classmethod
    def unpacked(cls, scene: CudaScene, slots: torch.Tensor, grid: Grid) -> Finer:
        means, shapes = scene.means[:, slots].T, scene.shapes[slots]
        scales = scene.scale_codes.scales(shapes)
        axes = rotations(shapes[:, 4:].double()) * scales[:, None]
        covariances = (axes[:, :, None] * axes[:, None]).sum(3).reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
        places = grid.places(means)
        inside = ((places >= 0) & (places <= 1)).all(1)
        sizes = torch.where(inside, scales.pow(4).sum(1).pow(0.25), math.inf)
        return cls(means.double(), covariances, opacities(shapes), grid.codes(means), sizes)


def edges(shift: torch.Tensor, cell: float) -> torch.Tensor:
    """float64: the longest edge of a cell with `shift` fewer bits in its Z-order code than the grid's own cells."""
    return torch.where(shift < 0, NEVER, cell * torch.exp2((shift.double() / 3).ceil()))


def shifts_for(
    most: int, group: torch.Tensor, codes: torch.Tensor, sizes: torch.Tensor, cell: float, least: torch.Tensor
) -> torch.Tensor:
    """The shift [G] of each group's smallest cells that leave at most `most` Gaussians; -1 if no cells do.

    group [N]: in ascending order. least [G]: minimum shift of each group. cell: the edge of the grid's own cells.
    """
    found = torch.full_like(least, -1)
    ends = torch.bincount(group, minlength=len(least)).cumsum(0)
    for shift in range(int(least.min()), 3 * BITS + 1):
        small = sizes <= float(edges(torch.tensor(shift), cell))
        member, first = _members(group, codes >> shift, small)
        left = torch.zeros(len(codes) + 1, dtype=torch.int64, device=codes.device)
        left[1:] = ~small
        left[1 + member] = first.long()
        counts = left.cumsum(0)[ends].diff(prepend=ends.new_zeros(1))
        found[(found < 0) & (least <= shift) & (counts <= most)] = shift
        if bool((found >= 0).all()):
            break
    return found


def _members(group: torch.Tensor, cells: torch.Tensor, small: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Indices of the small Gaussians, and whether each of them is the first in its cell."""
    member = small.nonzero().squeeze(1)
    cells, group = cells[member], group[member]
    first = torch.ones_like(member, dtype=torch.bool)
    first[1:] = (cells[1:] != cells[:-1]) | (group[1:] != group[:-1])
    return member, first


def _lengths(first: torch.Tensor) -> torch.Tensor:
    """Lengths of runs. first: whether each member is the first of its run."""
    begins = first.nonzero().squeeze(1)
    return begins.diff(append=begins.new_full((1,), len(first)))


def _at_groups(values: torch.Tensor, group: torch.Tensor, groups: int) -> torch.Tensor:
    """The value of each group's first element, in ascending order of groups; undefined for empty groups."""
    begins = torch.searchsorted(group, torch.arange(groups, device=group.device))
    return values[begins.clamp_max(len(values) - 1)] if len(values) else begins


def _copy(scene: CudaScene, source: torch.Tensor, into: torch.Tensor) -> None:
    scene.means[:, into] = scene.means[:, source]
    scene.shapes[into] = scene.shapes[source]
    scene.sh[:, into] = scene.sh[:, source]


def _write_merged(
    scene: CudaScene, slots: torch.Tensor, finer: Finer, lengths: torch.Tensor, into: torch.Tensor, blur: torch.Tensor
) -> None:
    """Merge each run of Gaussians and write the results."""
    if not len(into):
        return
    means, covariances, opacity, weights = merge(finer.means, finer.covariances, finer.opacities, lengths, blur)
    variances, axes = eigen(covariances)
    scene.means[:, into] = means.T.float()
    scene.shapes[into] = scene.scale_codes.shapes(0.5 * variances.clamp_min(1e-60).log2(), opacity, quaternions(axes))
    colours = scene.sh[:, slots].permute(1, 0, 2).reshape(len(slots), -1).float() * weights.float()[:, None]
    mixed = _reduce(colours, "sum", lengths).to(torch.float16)
    scene.sh[:, into] = mixed.reshape(len(into), -1, 4).permute(1, 0, 2)


def merge(
    means: torch.Tensor, covariances: torch.Tensor, opacities: torch.Tensor, lengths: torch.Tensor, blur: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Merge R runs of Gaussians to means [R, 3], covariances [R, 6] and opacities [R]; also gives colour weights [N].

    blur [N]: added to variances when areas are compared. See `cpu.levels.merge`.
    """
    run = torch.repeat_interleave(lengths)
    covered = opacities * _area(covariances, blur)
    weights = covered / _reduce(covered[:, None], "sum", lengths)[run, 0]
    mean = _reduce(weights[:, None] * means, "sum", lengths)
    x, y, z = (means - mean[run]).unbind(1)
    spread = torch.stack([x * x, x * y, x * z, y * y, y * z, z * z], 1)
    covariance = _reduce(weights[:, None] * (covariances + spread), "sum", lengths)
    whole = _area(covariance[run], blur)
    passed = _reduce(1 - (covered / whole).clamp_max(ALPHA_MAX)[:, None], "prod", lengths)
    return mean, covariance, 1 - passed[:, 0], weights


def _area(covariances: torch.Tensor, blur: torch.Tensor) -> torch.Tensor:
    """Mean area of ellipsoids' projections, up to a factor; see `cpu.levels.area`."""
    xx, xy, xz, yy, yz, zz = covariances.unbind(1)
    xx, yy, zz = xx + blur, yy + blur, zz + blur
    squared = xx * yy - xy * xy + yy * zz - yz * yz + zz * xx - xz * xz
    return squared.clamp_min(0).sqrt().clamp_min(LEAST_AREA)


def _reduce(values: torch.Tensor, by: str, lengths: torch.Tensor) -> torch.Tensor:
    """Reduce values [N, ...] over runs, in order, so that the result is deterministic, unlike with atomics."""
    return torch.segment_reduce(values, by, lengths=lengths, axis=0, unsafe=True)


def eigen(covariances: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Eigenvalues [N, 3], and rotations [N, 3, 3] with the eigenvectors as columns, by Jacobi's method.

    torch.linalg.eigh takes a hundred times as long for millions of small matrices.
    """
    xx, xy, xz, yy, yz, zz = covariances.unbind(1)
    a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    one, zero = torch.ones_like(xx), torch.zeros_like(xx)
    v = [[one, zero, zero], [zero, one, zero], [zero, zero, one]]
    for p, q in ROTATIONS:
        angle = 0.5 * torch.atan2(2 * a[p][q], a[q][q] - a[p][p])
        c, s = angle.cos(), angle.sin()
        for rows in (a, v):
            for row in rows:
                row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]
        a[p], a[q] = (
            [c * a[p][k] - s * a[q][k] for k in range(3)],
            [s * a[p][k] + c * a[q][k] for k in range(3)],
        )
    return torch.stack([a[k][k] for k in range(3)], 1), torch.stack([torch.stack(row, 1) for row in v], 1)


def rotations(quaternions: torch.Tensor) -> torch.Tensor:
    """Rotation matrices [N, 3, 3] of quaternions [N, 4] of any length."""
    w, x, y, z = torch.nn.functional.normalize(quaternions, dim=1).unbind(1)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack([torch.stack(row, 1) for row in rows], 1)


def quaternions(rotation: torch.Tensor) -> torch.Tensor:
    """Quaternions [N, 4], w first and not normalised, of rotations [N, 3, 3]."""
    (a, b, c), (d, e, f), (g, h, i) = (row.unbind(1) for row in rotation.unbind(1))
    # four times the quaternion's outer product with itself, of which the row with the largest diagonal is most accurate
    rows = (
        (1 + a + e + i, h - f, c - g, d - b),
        (h - f, 1 + a - e - i, b + d, c + g),
        (c - g, b + d, 1 - a + e - i, f + h),
        (d - b, c + g, f + h, 1 - a - e + i),
    )
    products = torch.stack([torch.stack(row, 1) for row in rows], 1)
    best = products.diagonal(dim1=1, dim2=2).argmax(1)
    return products[torch.arange(len(best), device=best.device), best]


def _bound(scene: CudaScene, children: slice, parents: slice, edge: torch.Tensor) -> None:
    """Fill the parents' bounds, and link the children to them.

    A parent's sphere contains its children's spheres, and its edge is longer than theirs, with a margin for rounding in
    the kernel. So whenever a parent is fine enough, its children are as well.
    """
    below, above = scene.bounds[children], scene.bounds[parents]
    family = _families(below.double(), below[-1].double())
    centres, radii = family[..., :3], family[..., 3:4]
    above[:, :3] = 0.5 * ((centres - radii).amin(1) + (centres + radii).amax(1))
    distances = (centres - above[:, None, :3].double()).norm(dim=2, keepdim=True)
    above[:, 3] = ((distances + radii).amax(1)[:, 0] * 1.001).float()
    held = scene.scale_codes.scales(scene.shapes[parents.start * CHUNK : parents.stop * CHUNK])
    above[:, DEVIATION] = held.reshape(-1, CHUNK * 3).amax(1) * 1.001
    theirs = family[..., EDGE].where(family[..., EDGE] < NEVER, 0).amax(1)
    above[:, EDGE] = torch.maximum(edge, 1.001 * theirs)
    numbers = torch.arange(parents.start, parents.stop, dtype=torch.int32, device=below.device)
    below.view(torch.int32)[:, PARENT] = numbers.repeat_interleave(FAN_OUT)[: len(below)]


def _families(of_children: torch.Tensor, filler: torch.Tensor | int) -> torch.Tensor:
    """Reshape [children, ...] to [parents, FAN_OUT, ...], padded with `filler` for the last parent."""
    missing = -len(of_children) % FAN_OUT
    rest = torch.zeros_like(of_children[:1]) + filler
    whole = torch.cat([of_children, rest.expand(missing, *rest.shape[1:])])
    return whole.reshape(-1, FAN_OUT, *of_children.shape[1:])
