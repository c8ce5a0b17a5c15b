"""Reads and writes PlayCanvas' compressed PLY: 16 bytes per Gaussian, plus one byte for each further coefficient.

The format, as written by https://github.com/playcanvas/splat-transform: chunks of 256 Gaussians have the ranges of
their positions, scales (logarithms) and, except in old files, colours as float32; each Gaussian is four uint32, packed
within these ranges; all further coefficients follow, channel-major.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import BrokenScene
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.ply import REST_COUNTS, Layout, has_lists, ply_header, read_layout, rest_names, size_problem
from tigas_render.scenes.scene_file import (
    BLOCK,
    C0,
    Columns,
    Floats,
    Listener,
    Rows,
    SceneFile,
    Table,
    add_largest,
    file_blocks,
)

CHUNK = 256
SH_RANGE = 8.0
"""Range of the stored coefficients, from −4 to 4."""
POSITION, SCALE, COLOUR = ("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")
RANGES = tuple(f"{end}_{name}" for names in (POSITION, SCALE, COLOUR) for end in ("min", "max") for name in names)
"""The properties of a chunk."""
PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
WRITE_BLOCK = 64 * CHUNK
"""Number of Gaussians packed at a time."""
LOG_SCALE_LIMIT = 20.0
ORIGIN = np.zeros((1, 3), np.float32)


@dataclass(frozen=True, slots=True)
class _Tables:
    chunks: Table
    vertices: Table
    coefficients: Table | None
    sh_degree: int
    file_bytes: int
    per_chunk: int = CHUNK
    """Vertices per chunk."""

    def every(self, step: int) -> _Tables:
        """Every nth vertex, without coefficients. step: a divisor of CHUNK."""
        return _Tables(self.chunks, self.vertices.every(step), None, 0, self.file_bytes, CHUNK // step)


def is_compressed(start: bytes) -> bool:
    """Whether a PLY with this start is a compressed PLY."""
    return b"packed_position" in start.partition(b"end_header")[0]


def read_compressed_ply(path: Path) -> SceneFile:
    """Describe a file. Raises OSError, and BrokenScene, with one sentence, if its header or size is wrong."""
    layout = read_layout(path)
    if layout.ply.text:
        raise BrokenScene(f"{path.name} is a compressed PLY in text form; only binary ones can be read.")
    tables = dict(_tables(path.name, layout))
    for name in ("chunk", "vertex"):
        if name not in tables:
            raise BrokenScene(f"{path.name} is not a compressed PLY: it has no element '{name}'.")
    chunks, vertices, coefficients, sh_degree = tables["chunk"], tables["vertex"], tables.get("sh"), 0
    _check_fields(path.name, "vertex", vertices, PACKED, "<u4")
    _check_fields(path.name, "chunk", chunks, RANGES if _has_colours(chunks.dtype) else RANGES[:12], "<f4")
    if vertices.count == 0:
        raise BrokenScene(f"{path.name} has 0 vertices, so there is nothing to show.")
    if chunks.count != math.ceil(vertices.count / CHUNK):
        raise BrokenScene(f"{path.name} has {chunks.count} chunks of {CHUNK} for {vertices.count} vertices.")
    if coefficients is not None:
        rest = len(coefficients.dtype.names or ())
        if rest not in REST_COUNTS or coefficients.count != vertices.count:
            raise BrokenScene(f"{path.name} has {coefficients.count} × {rest} coefficients in its element 'sh'.")
        sh_degree = REST_COUNTS[rest]
        _check_fields(path.name, "sh", coefficients, rest_names(sh_degree), "u1")
    file_bytes, needed = layout.file_bytes, max(table.end for table in tables.values())
    if file_bytes != needed:
        raise size_problem(path.name, vertices.count, needed, file_bytes)
    all = _Tables(chunks, vertices, coefficients, sh_degree, file_bytes)
    decode, antialiased = partial(_decode, path, all), layout.antialiased
    file = SceneFile("compressed PLY", (path,), vertices.count, sh_degree, file_bytes, decode, antialiased)
    return file.with_sample(lambda step, listener: _decode(path, all.every(step), listener))


def _tables(name: str, layout: Layout) -> Iterator[tuple[str, Table]]:
    offset = layout.data_offset
    for element in layout.ply.elements:
        if has_lists(element):
            raise BrokenScene(f"{name} has lists in element '{element.name}'; a compressed PLY has none.")
        table = Table(offset, layout.counts[element.name], np.dtype(element.dtype("<")))
        yield element.name, table
        offset = table.end


def _check_fields(name: str, element: str, table: Table, names: Sequence[str], kind: str) -> None:
    fields: Any = table.dtype.fields or {}
    wrong = next((field for field in names if field not in fields or fields[field][0] != np.dtype(kind)), None)
    if wrong is not None:
        raise BrokenScene(f"{name} has no property '{wrong}' of the right type in element '{element}'.")


def _has_colours(chunk: np.dtype[np.void]) -> bool:
    return any(name in RANGES[12:] for name in chunk.names or ())


def _decode(path: Path, tables: _Tables, listener: Listener) -> Iterator[Columns]:
    assert BLOCK % CHUNK == 0  # so that a block begins with a chunk
    rest = rest_names(tables.sh_degree)
    for file, block in file_blocks(path, tables.file_bytes, tables.vertices.count, listener):
        size = tables.per_chunk
        chunks = tables.chunks.rows(file, block.start // size, math.ceil(block.stop / size))
        columns = _columns(tables.vertices.rows(file, block.start, block.stop), chunks, size, tables.sh_degree)
        if tables.coefficients is not None:
            rows = tables.coefficients.rows(file, block.start, block.stop)
            columns.sh[:, 1:] = _coefficients(rows, rest)
        yield columns


def _columns(vertices: Rows, chunks: Rows, per_chunk: int, sh_degree: int) -> Columns:
    columns = Columns(len(vertices), sh_degree)
    chunk = np.arange(len(vertices)) // per_chunk
    colour = _unpack(vertices["packed_color"], (8, 8, 8, 8))
    rotation = vertices["packed_rotation"]
    with np.errstate(all="ignore"):  # overflowing values are dropped later
        columns.means[:] = _scale(_unpack(vertices["packed_position"], (11, 10, 11)), chunks, POSITION, chunk)
        columns.scales[:] = np.exp(_scale(_unpack(vertices["packed_scale"], (11, 10, 11)), chunks, SCALE, chunk))
        hue = colour[:, :3]
        if _has_colours(chunks.dtype):
            hue = _scale(hue, chunks, COLOUR, chunk)
        columns.sh[:, 0] = (hue - 0.5) / C0
    columns.opacities[:] = colour[:, 3]
    columns.quaternions[:] = add_largest((_unpack(rotation, (10, 10, 10)) - 0.5) * math.sqrt(2), rotation >> 30)
    return columns


def _unpack(words: NDArray[np.uint32], bits: Sequence[int]) -> Floats:
    """Unpack fractions, 0 to 1, from words [N] with the given bits, the last in the lowest bits: [N, len(bits)]."""
    ends = np.cumsum(np.array(bits[::-1]))[::-1]
    shifts = np.append(ends[1:], 0).astype(np.uint32)
    most = (1 << np.array(bits, np.uint32)) - 1
    fields: NDArray[Any] = words[:, None] >> shifts & most
    shares: Floats = fields / most
    return shares


def _scale(shares: Floats, chunks: Rows, names: Sequence[str], chunk: NDArray[np.intp]) -> Floats:
    """Values [N, 3] at the given fractions of their chunks' ranges. chunk: [N] chunk indices."""
    low, high = (
        np.column_stack([chunks[f"{end}_{name}"] for name in names]).astype(np.float64)[chunk] for end in ("min", "max")
    )
    values: Floats = low + (high - low) * shares
    return values


def _coefficients(rows: Rows, names: Sequence[str]) -> Floats:
    """Decode bytes like PlayCanvas: 0 and 255 to the ends of the range, others to mid-steps: [len(rows), K − 1, 3]."""
    content: Floats = np.column_stack([rows[name] for name in names]).astype(np.float32)
    shares = np.where(content == 0, 0, np.where(content == 255, 1, (content + 0.5) / 256))
    values: Floats = ((shares - 0.5) * SH_RANGE).reshape(len(rows), 3, -1).transpose(0, 2, 1)
    return values


def write_compressed_ply(
    path: Path,
    gaussians: Gaussians,
    order: NDArray[np.int64],
    comments: Iterable[str] = (),
    shifts: Floats = ORIGIN,
    check: Callable[[], None] = lambda: None,
) -> None:
    """Write the Gaussians at these indices [M] in this order, once for each shift [C, 3] in scene units.

    Chunks should hold neighbours, and with several shifts, M must be a multiple of CHUNK. comments: for the header.
    check: called regularly, and may raise an error to abort.

    Memory beyond the arrays themselves is a few megabytes. Raises OSError.
    """
    rest, count = rest_names(gaussians.sh_degree), len(shifts) * len(order)
    chunks = math.ceil(count / CHUNK)
    elements = [
        ("chunk", chunks, "float", RANGES),
        ("vertex", count, "uint", PACKED),
        *([("sh", count, "uchar", rest)] if rest else []),
    ]
    header = ply_header(elements, comments)
    ends = [len(header), len(header) + 4 * len(RANGES) * chunks]
    ends.append(ends[1] + 4 * len(PACKED) * count)
    blocks = [order[start : start + WRITE_BLOCK] for start in range(0, len(order), WRITE_BLOCK)]
    with path.open("wb") as file:
        file.write(header)
        for shift in shifts:
            for block in blocks:
                check()
                for element, content in enumerate(_pack(gaussians, block, shift)):
                    file.seek(ends[element])
                    ends[element] += file.write(content)


def _pack(gaussians: Gaussians, block: NDArray[np.int64], shift: Floats) -> tuple[bytes, bytes, bytes]:
    """A block's rows for each element: ranges [chunks, 18], words [len(block), 4], and coefficients."""
    scales = gaussians.scales[block].clip(np.finfo(np.float32).tiny)
    positions, position_ranges = _normalise_to_chunks(gaussians.means[block] + shift)
    sizes, size_ranges = _normalise_to_chunks(np.log(scales).clip(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT))
    hues, hue_ranges = _normalise_to_chunks(gaussians.sh[:, 0][block] * C0 + 0.5)
    opacities = gaussians.opacities[block, None]
    largest, others = _pack_rotations(gaussians.quaternions[block])
    words = (
        _pack_words(positions, (11, 10, 11)),
        _pack_words(others, (10, 10, 10)) | largest << 30,
        _pack_words(sizes, (11, 10, 11)),
        _pack_words(np.concatenate((hues, opacities), axis=1), (8, 8, 8, 8)),
    )
    ranges = np.concatenate((position_ranges, size_ranges, hue_ranges), axis=1)
    coefficients = _pack_coefficients(gaussians, block) if gaussians.sh_degree else np.empty(0, np.uint8)
    return ranges.astype("<f4").tobytes(), np.stack(words, axis=1).astype("<u4").tobytes(), coefficients.tobytes()


def _normalise_to_chunks(values: Floats) -> tuple[Floats, Floats]:
    """Values [N, 3] as fractions, 0 to 1, of their chunks' ranges; and the ranges [chunks, 6], lows before highs."""
    starts = np.arange(0, len(values), CHUNK)
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    chunk = np.arange(len(values)) // CHUNK
    extent = np.maximum(high.astype(np.float64) - low, np.finfo(np.float32).tiny)
    return (values - low[chunk]) / extent[chunk], np.concatenate((low, high), axis=1)


def _pack_rotations(quaternions: Floats) -> tuple[NDArray[np.uint32], Floats]:
    """The index of the largest component [N] of unit quaternions w, x, y, z [N, 4], and the others [N, 3], 0 to 1."""
    largest = np.abs(quaternions).argmax(1)[:, None]
    positive = quaternions * np.where(np.take_along_axis(quaternions, largest, 1) < 0, -1, 1)
    others = positive[np.arange(4) != largest].reshape(-1, 3)
    return largest[:, 0].astype(np.uint32), others / math.sqrt(2) + 0.5


def _pack_coefficients(gaussians: Gaussians, block: NDArray[np.int64]) -> NDArray[np.uint8]:
    """All coefficients but the first, [len(block), 3, K − 1]."""
    rest = gaussians.sh[block, 1:].transpose(0, 2, 1)
    # 0 is halfway between two steps, so the rounding direction alternates to avoid a colour cast
    side = 1e-4 * np.where(np.indices(rest.shape).sum(0) % 2, 1, -1)
    return _quantise(rest / SH_RANGE + 0.5 + side, 8).astype(np.uint8)


def _pack_words(shares: Floats, bits: Sequence[int]) -> NDArray[np.uint32]:
    """Pack fractions [N, k], 0 to 1, with the given bits each, the first in the highest bits: [N]."""
    word = np.zeros(len(shares), np.uint32)
    for column, each in zip(shares.T, bits, strict=True):
        word <<= np.uint32(each)
        word |= _quantise(column, each)
    return word


def _quantise(shares: Floats, bits: int) -> NDArray[np.uint32]:
    whole: NDArray[np.uint32] = np.rint(shares.clip(0, 1) * ((1 << bits) - 1)).astype(np.uint32)
    return whole
