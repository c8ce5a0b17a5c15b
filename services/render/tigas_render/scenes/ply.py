"""Loads and writes 3D Gaussian Splatting scenes in INRIA's PLY format.

The format (https://github.com/graphdeco-inria/gaussian-splatting): `scale_*` are logarithms, `opacity` is a logit,
`rot_*` is a quaternion w, x, y, z of any length, and `f_rest_*` is channel-major: all red coefficients, then green,
then blue.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from plyfile import PlyData, PlyElement

from tigas_common.errors import BrokenScene
from tigas_render.scenes.gaussians import Gaussians
from tigas_render.scenes.ply_header import MAX_HEADER, REQUIRED, PlyHeader, read_header

BLOCK = 16_384
"""Vertices that are converted at a time, so that nothing but the tensors grows with the scene."""

_log = logging.getLogger(__name__)

_Block = np.ndarray[tuple[int], np.dtype[np.void]]


def load_ply(path: Path, device: str | torch.device = "cpu") -> Gaussians:
    """Load a scene; Gaussians with NaN or infinite attributes or without a rotation are dropped with a warning.

    Memory beyond the tensors themselves is a few megabytes, whatever the scene's size.
    Raises BrokenScene, with one sentence, if the file is not a complete INRIA 3DGS PLY.
    """
    header = read_header(path)
    n, k = header.count, (header.sh_degree + 1) ** 2
    gaussians = Gaussians(
        means=torch.empty(n, 3, device=device),
        scales=torch.empty(n, 3, device=device),
        quaternions=torch.empty(n, 4, device=device),
        opacities=torch.empty(n, device=device),
        sh=torch.empty(n, k, 3, device=device),
    )
    kept = 0
    try:
        for block in _ascii_blocks(path, header) if header.ascii else _binary_blocks(path, header):
            part = _activate(block, header.sh_degree)
            end = kept + len(part)
            gaussians.means[kept:end] = part.means
            gaussians.scales[kept:end] = part.scales
            gaussians.quaternions[kept:end] = part.quaternions
            gaussians.opacities[kept:end] = part.opacities
            gaussians.sh[kept:end] = part.sh
            kept = end
    except OSError as error:
        raise BrokenScene(f"{path.name} cannot be read: {error.strerror or error}.") from None
    if kept == 0:
        raise BrokenScene(f"{path.name} has no Gaussian without NaN or infinite attributes.")
    if kept == n:
        return gaussians
    _log.warning("%s: dropped %d of %d Gaussians with NaN or infinite attributes", path, n - kept, n)
    return Gaussians(
        gaussians.means[:kept],
        gaussians.scales[:kept],
        gaussians.quaternions[:kept],
        gaussians.opacities[:kept],
        gaussians.sh[:kept],
    )


def write_ply(path: Path, gaussians: Gaussians) -> None:
    """Write a scene as an INRIA PLY, binary little-endian; opacities are kept 1e-6 away from 0 and 1."""
    opacities = gaussians.opacities.clamp(1e-6, 1 - 1e-6)
    columns = {
        "x y z": gaussians.means,
        "f_dc_0 f_dc_1 f_dc_2": gaussians.sh[:, 0],
        _rest_names(gaussians.sh_degree): gaussians.sh[:, 1:].transpose(1, 2).flatten(1),
        "opacity": torch.logit(opacities)[:, None],
        "scale_0 scale_1 scale_2": gaussians.scales.log(),
        "rot_0 rot_1 rot_2 rot_3": gaussians.quaternions,
    }
    rows = np.empty(len(gaussians), [(name, "<f4") for names in columns for name in names.split()])
    for names, values in columns.items():
        for name, column in zip(names.split(), values.cpu().numpy().T, strict=True):
            rows[name] = column
    PlyData([PlyElement.describe(rows, "vertex")], byte_order="<").write(str(path))


def _rest_names(sh_degree: int) -> str:
    return " ".join(f"f_rest_{i}" for i in range(3 * ((sh_degree + 1) ** 2 - 1)))


def _binary_blocks(path: Path, header: PlyHeader) -> Iterator[_Block]:
    # a mapping per block: pages of earlier blocks do not stay resident, as they would with one mapping of the file
    for start in range(0, header.count, BLOCK):
        rows = min(BLOCK, header.count - start)
        offset = header.offset + start * header.dtype.itemsize
        if path.stat().st_size != header.file_bytes:
            raise BrokenScene(f"{path.name} changed while it was being read; load it again.")
        yield np.memmap(path, header.dtype, "r", offset, (rows,))


def _ascii_blocks(path: Path, header: PlyHeader) -> Iterator[_Block]:
    # NumPy's text reader, as plyfile's takes about a microsecond for each number and reads all of the file at once
    with path.open(encoding="ascii", errors="replace") as file:
        file.seek(header.offset)
        lines = iter(lambda: file.readline(MAX_HEADER), "")  # bounded: the file may have no line ends at all
        for _ in itertools.islice(lines, header.skip_lines):
            pass
        for start in range(0, header.count, BLOCK):
            rows = list(itertools.islice(lines, min(BLOCK, header.count - start)))
            if start + len(rows) < min(header.count, start + BLOCK):
                raise BrokenScene(
                    f"{path.name} is truncated: it promises {header.count} vertices and has {start + len(rows)}."
                )
            try:
                block = np.loadtxt(rows, header.dtype, comments=None, ndmin=1)
            except (ValueError, OverflowError) as error:
                raise BrokenScene(
                    f"{path.name} has a vertex that cannot be read: {_text_error(error, start)}."
                ) from None
            if len(block) != len(rows):
                raise BrokenScene(f"{path.name} has an empty line among its vertices.")
            yield block


def _text_error(error: Exception, start: int) -> str:
    """NumPy's words about a row, which it counts from the block's first."""
    first = str(error).split(";")[0].split(".\n")[0].rstrip(".")
    return f"{first} (counted from vertex {start})" if start else first


def _activate(block: _Block, sh_degree: int) -> Gaussians:
    """The block's Gaussians in float32 with activations applied, without those that are not finite."""
    columns = _columns(block, REQUIRED)
    quaternions = columns[:, 10:14].double()  # double, as the square of a float32 may overflow
    scales = columns[:, 7:10].exp()
    quaternions = (quaternions / quaternions.norm(dim=1, keepdim=True)).float()
    opacities = columns[:, 6].sigmoid()
    rest = _columns(block, _rest_names(sh_degree).split()).reshape(len(block), 3, (sh_degree + 1) ** 2 - 1)
    sh = torch.cat((columns[:, None, 3:6], rest.transpose(1, 2)), dim=1)
    finite = columns.isfinite().all(1) & scales.isfinite().all(1) & quaternions.isfinite().all(1)
    finite &= sh.flatten(1).isfinite().all(1)
    return Gaussians(columns[finite, 0:3], scales[finite], quaternions[finite], opacities[finite], sh[finite])


def _columns(block: _Block, names: tuple[str, ...] | list[str]) -> torch.Tensor:
    """[rows, len(names)] float32."""
    columns = np.empty((len(block), len(names)), np.float32)
    with np.errstate(over="ignore"):  # a double beyond float32 becomes infinite, and its Gaussian is dropped
        for i, name in enumerate(names):
            columns[:, i] = block[name]
    return torch.from_numpy(columns)
