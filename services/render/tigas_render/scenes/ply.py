"""Loads 3D Gaussian Splatting scenes in INRIA's PLY format.

The format (https://github.com/graphdeco-inria/gaussian-splatting): `scale_*` are logarithms, `opacity` is a logit,
`rot_*` is a quaternion w, x, y, z of any length, and `f_rest_*` is channel-major: all red coefficients, then green,
then blue.
"""

from __future__ import annotations

import io
import itertools
import os
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.columns import BLOCK, Columns, Floats, Listener, blocks, normalised
from tigas_render.scenes.ply_header import MAX_HEADER, REQUIRED, PlyHeader, read_header
from tigas_render.scenes.scene_file import SceneFile, unreadable

_Block = np.ndarray[tuple[int], np.dtype[np.void]]


def read_ply(path: Path) -> SceneFile:
    """Description of the file. Raises BrokenScene, with one sentence, if it is not an INRIA 3DGS PLY."""
    header = read_header(path)
    return SceneFile(
        "PLY", (path,), header.count, header.sh_degree, header.file_bytes, partial(_decode, path), header.antialiased
    )


def load_ply(path: Path) -> Gaussians:
    """Load a scene; Gaussians that cannot be drawn are dropped with a warning (`columns.drawable`).

    Memory beyond the arrays themselves is a few megabytes, for any scene. Raises BrokenScene, with one sentence, if the
    file is not a complete INRIA 3DGS PLY.
    """
    return read_ply(path).load()


def _decode(path: Path, listener: Listener) -> Iterator[Columns]:
    header = read_header(path)
    try:
        decoded = _ascii_blocks(path, header) if header.ascii else _binary_blocks(path, header)
        for _, block in zip(blocks(header.count, listener), decoded, strict=True):
            yield _columns(block, header.sh_degree)
    except OSError as error:
        raise unreadable(path, error) from None


def ply_header(elements: Iterable[tuple[str, int, str, Iterable[str]]], comments: Iterable[str] = ()) -> bytes:
    """The header of a binary little-endian PLY: its elements' names, counts, type and names of all properties."""
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {comment}" for comment in comments)]
    for element, count, kind, properties in elements:
        lines += [f"element {element} {count}", *(f"property {kind} {name}" for name in properties)]
    return "\n".join([*lines, "end_header", ""]).encode()


def rest_names(sh_degree: int) -> list[str]:
    """Names of the properties with a Gaussian's SH coefficients beyond the first."""
    return [f"f_rest_{i}" for i in range(3 * ((sh_degree + 1) ** 2 - 1))]


def _binary_blocks(path: Path, header: PlyHeader) -> Iterator[_Block]:
    with open_regular(path) as file:
        # a mapping per block: pages of earlier blocks do not stay resident, as they would with one mapping of the file
        for start in range(0, header.count, BLOCK):
            rows = min(BLOCK, header.count - start)
            offset = header.offset + start * header.dtype.itemsize
            if os.fstat(file.fileno()).st_size != header.file_bytes:
                raise BrokenScene(f"{path.name} changed while it was being read; load it again.")
            yield np.memmap(file, header.dtype, "r", offset, (rows,))


def _ascii_blocks(path: Path, header: PlyHeader) -> Iterator[_Block]:
    # NumPy's text reader, as plyfile's takes about a microsecond for each number and reads all of the file at once
    with io.TextIOWrapper(open_regular(path), encoding="ascii", errors="replace") as file:
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


def _columns(block: _Block, sh_degree: int) -> Columns:
    """Decode a block; a Gaussian with a value that is not finite gets an opacity that drops it."""
    columns = Columns(len(block), sh_degree)
    with np.errstate(all="ignore"):
        values = _values(block, REQUIRED)
        opacities = 1 / (1 + np.exp(-values[:, 6]))
        columns.means[:] = values[:, 0:3]
        columns.scales[:] = np.exp(values[:, 7:10])
        columns.quaternions[:] = normalised(values[:, 10:14])
        columns.opacities[:] = np.where(np.isfinite(values).all(1), opacities, np.nan)
        columns.sh[:, 0] = values[:, 3:6]
        rest = _values(block, rest_names(sh_degree)).reshape(len(block), 3, -1 if sh_degree else 0)
    columns.sh[:, 1:] = rest.transpose(0, 2, 1)
    return columns


def _values(block: _Block, names: Sequence[str]) -> Floats:
    """[rows, len(names)]; a double beyond float32 becomes infinite."""
    values = np.empty((len(block), len(names)), np.float32)
    for i, name in enumerate(names):
        values[:, i] = block[name]
    return values
