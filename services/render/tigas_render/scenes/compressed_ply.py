"""Reads PlayCanvas' compressed PLY: 16 bytes a Gaussian, and a byte for each further coefficient of its colour.

The format, as https://github.com/playcanvas/splat-transform writes it: chunks of 256 Gaussians have the ranges of
their positions, scales (logarithms) and, in all but old files, colours as float32; each Gaussian is four uint32, packed
within these ranges; coefficients are channel-major. `downloads.compressed_ply` writes it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular
from tigas_render.scenes.columns import BLOCK, C0, Columns, Floats, Listener, blocks, with_largest
from tigas_render.scenes.ply import rest_names
from tigas_render.scenes.ply_header import REST_COUNTS, Layout, has_lists, read_layout, says_antialiased, size_problem
from tigas_render.scenes.scene_file import SceneFile, unreadable

CHUNK = 256
SH_RANGE = 8.0
"""Coefficients are kept from −4 to 4."""
POSITION, SCALE, COLOUR = ("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")
RANGES = tuple(f"{end}_{name}" for names in (POSITION, SCALE, COLOUR) for end in ("min", "max") for name in names)
"""The properties of a chunk."""
PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")

_Rows = NDArray[np.void]


@dataclass(frozen=True, slots=True)
class _Table:
    """An element's rows in the file."""

    offset: int
    count: int
    dtype: np.dtype[np.void]

    @property
    def end(self) -> int:
        return self.offset + self.count * self.dtype.itemsize

    def rows(self, file: BufferedReader, start: int, stop: int) -> _Rows:
        # a mapping each time: pages of earlier ones do not stay resident, as they would with one mapping of the file
        return np.memmap(file, self.dtype, "r", self.offset + start * self.dtype.itemsize, (stop - start,))


@dataclass(frozen=True, slots=True)
class _Tables:
    chunks: _Table
    vertices: _Table
    coefficients: _Table | None
    sh_degree: int
    file_bytes: int
    antialiased: bool


def is_compressed(start: bytes) -> bool:
    """Whether a PLY that begins so is one of these."""
    return b"packed_position" in start.partition(b"end_header")[0]


def read_compressed_ply(path: Path) -> SceneFile:
    """Description of the file. Raises BrokenScene, with one sentence, if its header or size is wrong."""
    tables = _read_tables(path)
    return SceneFile(
        "compressed PLY",
        (path,),
        tables.vertices.count,
        tables.sh_degree,
        tables.file_bytes,
        partial(_decode, path),
        tables.antialiased,
    )


def _read_tables(path: Path) -> _Tables:
    layout = read_layout(path)
    if layout.ply.text:
        raise BrokenScene(f"{path.name} is a compressed PLY as text; such files are binary.")
    tables = dict(_tables(path.name, layout))
    chunks, vertices = (_table(path.name, tables, name) for name in ("chunk", "vertex"))
    _check_fields(path.name, "vertex", vertices, PACKED, "<u4")
    _check_fields(path.name, "chunk", chunks, RANGES if _has_colours(chunks.dtype) else RANGES[:12], "<f4")
    if vertices.count == 0:
        raise BrokenScene(f"{path.name} has 0 vertices, so there is nothing to show.")
    if chunks.count != math.ceil(vertices.count / CHUNK):
        raise BrokenScene(f"{path.name} has {chunks.count} chunks of {CHUNK} for {vertices.count} vertices.")
    coefficients, sh_degree = tables.get("sh"), 0
    if coefficients is not None:
        rest = len(coefficients.dtype.names or ())
        if rest not in REST_COUNTS or coefficients.count != vertices.count:
            raise BrokenScene(f"{path.name} has {coefficients.count} × {rest} coefficients in its element 'sh'.")
        sh_degree = REST_COUNTS[rest]
        _check_fields(path.name, "sh", coefficients, rest_names(sh_degree), "u1")
    needed = max(table.end for table in tables.values())
    if layout.file_bytes != needed:
        raise BrokenScene(size_problem(path.name, vertices.count, "", needed, layout.file_bytes))
    antialiased = says_antialiased(layout.ply.comments)
    return _Tables(chunks, vertices, coefficients, sh_degree, layout.file_bytes, antialiased)


def _tables(name: str, layout: Layout) -> Iterator[tuple[str, _Table]]:
    offset = layout.data_offset
    for element in layout.ply.elements:
        if has_lists(element):
            raise BrokenScene(f"{name} has lists in element '{element.name}'; a compressed PLY has none.")
        table = _Table(offset, layout.counts[element.name], np.dtype(element.dtype("<")))
        yield element.name, table
        offset = table.end


def _table(name: str, tables: dict[str, _Table], element: str) -> _Table:
    try:
        return tables[element]
    except KeyError:
        raise BrokenScene(f"{name} is no compressed PLY: it has no element '{element}'.") from None


def _check_fields(name: str, element: str, table: _Table, names: Sequence[str], kind: str) -> None:
    fields: Mapping[str, Any] = table.dtype.fields or {}
    wrong = next((field for field in names if field not in fields or fields[field][0] != np.dtype(kind)), None)
    if wrong is not None:
        raise BrokenScene(f"{name} has no property '{wrong}' of the right type in element '{element}'.")


def _has_colours(chunk: np.dtype[np.void]) -> bool:
    return any(name in RANGES[12:] for name in chunk.names or ())


def _decode(path: Path, listener: Listener) -> Iterator[Columns]:
    tables = _read_tables(path)
    rest = rest_names(tables.sh_degree)
    try:
        with open_regular(path) as file:
            for block in blocks(tables.vertices.count, listener):
                if os.fstat(file.fileno()).st_size != tables.file_bytes:
                    raise BrokenScene(f"{path.name} changed while it was being read; load it again.")
                first, last = block.start // CHUNK, math.ceil(block.stop / CHUNK)
                chunks = tables.chunks.rows(file, first, last)
                columns = _columns(tables.vertices.rows(file, block.start, block.stop), chunks, tables.sh_degree)
                if tables.coefficients is not None:
                    rows = tables.coefficients.rows(file, block.start, block.stop)
                    columns.sh[:, 1:] = _coefficients(rows, rest)
                yield columns
    except OSError as error:
        raise unreadable(path, error) from None


def _columns(vertices: _Rows, chunks: _Rows, sh_degree: int) -> Columns:
    assert BLOCK % CHUNK == 0  # so that a block begins with a chunk
    columns = Columns(len(vertices), sh_degree)
    chunk = np.arange(len(vertices)) // CHUNK
    colour = _shares(vertices["packed_color"], (8, 8, 8, 8))
    rotation = vertices["packed_rotation"]
    with np.errstate(all="ignore"):  # overflowing values are dropped later
        columns.means[:] = _within(_shares(vertices["packed_position"], (11, 10, 11)), chunks, POSITION, chunk)
        columns.scales[:] = np.exp(_within(_shares(vertices["packed_scale"], (11, 10, 11)), chunks, SCALE, chunk))
        hue = colour[:, :3]
        if _has_colours(chunks.dtype):
            hue = _within(hue, chunks, COLOUR, chunk)
        columns.sh[:, 0] = (hue - 0.5) / C0
    columns.opacities[:] = colour[:, 3]
    columns.quaternions[:] = with_largest((_shares(rotation, (10, 10, 10)) - 0.5) * math.sqrt(2), rotation >> 30)
    return columns


def _shares(words: NDArray[np.uint32], bits: Sequence[int]) -> Floats:
    """Numbers from 0 to 1 packed in words [N] with the given bits each, the last in the lowest bits: [N, len(bits)]."""
    ends = np.cumsum(np.array(bits[::-1]))[::-1]
    shifts = np.append(ends[1:], 0).astype(np.uint32)
    most = (1 << np.array(bits, np.uint32)) - 1
    fields: NDArray[Any] = words[:, None] >> shifts & most
    shares: Floats = fields / most
    return shares


def _within(shares: Floats, chunks: _Rows, names: Sequence[str], chunk: NDArray[np.intp]) -> Floats:
    """Shares [N, 3] of the ranges that their chunks have."""
    low, high = (
        np.column_stack([chunks[f"{end}_{name}"] for name in names]).astype(np.float64)[chunk] for end in ("min", "max")
    )
    values: Floats = low + (high - low) * shares
    return values


def _coefficients(rows: _Rows, names: Sequence[str]) -> Floats:
    """[len(rows), K − 1, 3], as PlayCanvas decodes bytes: both ends, and the middles of the steps between."""
    content: Floats = np.column_stack([rows[name] for name in names]).astype(np.float32)
    shares = np.where(content == 0, 0, np.where(content == 255, 1, (content + 0.5) / 256))
    values: Floats = ((shares - 0.5) * SH_RANGE).reshape(len(rows), 3, -1).transpose(0, 2, 1)
    return values
