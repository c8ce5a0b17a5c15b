"""Reads 3D Gaussian Splatting scenes in INRIA's PLY format.

The format (https://github.com/graphdeco-inria/gaussian-splatting): `scale_*` are logarithms, `opacity` is a logit,
`rot_*` is a quaternion w, x, y, z of any length, and `f_rest_*` is channel-major: all red coefficients, then green,
then blue. The header is validated before anything is allocated. Memory for decoding is a few megabytes for any scene.
"""

from __future__ import annotations

import io
import itertools
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement, PlyListProperty, PlyParseError

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular
from tigas_render.scenes.scene_file import (
    Columns,
    Floats,
    Listener,
    Rows,
    SceneFile,
    Table,
    file_blocks,
    normalise,
    read_start,
    row_blocks,
)

MAX_HEADER = 64 * 1024
"""Maximum size of a header in bytes; with SH degree 3, it takes about 1,500."""
REST_COUNTS = {0: 0, 9: 1, 24: 2, 45: 3}
"""SH degree by number of f_rest_* properties, which is 3 · ((degree + 1)² − 1)."""
ANTIALIASED = "SplatRenderMode: mip"
"""The comment by which Brush marks antialiased scenes."""
REQUIRED = (
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)

_END = re.compile(rb"^end_header *\r?\n", re.MULTILINE)
_LINE = re.compile(rb" *|[!-~][ -~]*|(comment|obj_info)[\t -~\x80-\xff]*")
"""A line without its end. With white space other than spaces, plyfile would see elements that `_ELEMENT` misses."""
_NOT_ASCII = re.compile(rb"[\x80-\xff]")
"""Bytes allowed only in comments, such as names and paths. plyfile cannot read them."""
_ELEMENT = re.compile(rb"^(element +([!-~]+) +)([0-9]+) *(\r?)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Layout:
    """The header of a PLY that is not big-endian."""

    ply: PlyData
    """The header as read by plyfile, without data."""
    counts: dict[str, int]
    """Number of rows by element."""
    data_offset: int
    """Number of bytes before the first element."""
    file_bytes: int

    @property
    def antialiased(self) -> bool:
        """Whether a comment of Brush or Postshot marks the scene as antialiased; the last such comment counts."""
        said = False
        for comment in self.ply.comments:
            match comment.lower().split():
                case ["splatrendermode:", mode]:
                    said = mode == "mip"
                case ["antialiased", flag]:  # Postshot's
                    said = flag == "1"
        return said


def read_ply(path: Path) -> SceneFile:
    """Describe a file. Raises OSError, and BrokenScene, with one sentence, if it is not an INRIA 3DGS PLY."""
    layout = read_layout(path)
    ply, counts, offset, file_bytes = layout.ply, layout.counts, layout.data_offset, layout.file_bytes
    if "vertex" not in ply:
        raise BrokenScene(f"{path.name} has no element 'vertex', so it holds no Gaussians.")
    vertex, count = ply["vertex"], counts["vertex"]
    sh_degree = _check_properties(path.name, vertex)
    if count == 0:
        raise BrokenScene(f"{path.name} has 0 vertices, so there is nothing to show.")
    before = ply.elements[: ply.elements.index(vertex)]
    after = ply.elements[len(before) + 1 :]
    if ply.text:
        skip_lines = sum(counts[element.name] for element in before)
        needed, is_exact = offset + 2 * (skip_lines + count * len(vertex.properties)) - 1, False  # a digit, a separator
        decoded = partial(_ascii_rows, path, offset, skip_lines, count, vertex.dtype("="))
    else:
        for element in before:
            if has_lists(element):
                raise BrokenScene(
                    f"{path.name} has lists in element '{element.name}' before its vertices; put them after."
                )
            offset += counts[element.name] * element.dtype("<").itemsize
        table = Table(offset, count, vertex.dtype("<"))
        needed, is_exact = table.end, not any(map(has_lists, after))
        if is_exact:
            needed += sum(counts[element.name] * element.dtype("<").itemsize for element in after)
        decoded = partial(_binary_rows, path, file_bytes, table)
    if file_bytes < needed or (is_exact and file_bytes != needed):
        raise size_problem(path.name, count, needed, file_bytes, is_exact=is_exact)
    decode, antialiased = partial(_decode, decoded, sh_degree), layout.antialiased
    file = SceneFile("PLY", (path,), count, sh_degree, file_bytes, decode, antialiased)
    if ply.text:
        return file

    def every(step: int, listener: Listener) -> Iterator[Columns]:
        return _decode(partial(_binary_rows, path, file_bytes, table.every(step)), 0, listener)

    return file.with_sample(every)


def read_layout(path: Path) -> Layout:
    """Read a header of at most MAX_HEADER bytes, without trusting any size in it. Raises OSError and BrokenScene."""
    start, file_bytes = read_start(path, MAX_HEADER)
    header, counts = _header_and_counts(path.name, start, file_bytes)
    try:
        # plyfile would continue with the elements, so it gets an empty file
        ply = PlyData.read(io.BytesIO(_ELEMENT.sub(rb"\g<1>0\4", _NOT_ASCII.sub(b"?", header))))
    except (PlyParseError, ValueError, UnicodeDecodeError) as error:
        reason = textwrap.shorten(str(error), 120, placeholder=" …").rstrip(".")
        raise BrokenScene(f"{path.name} has a broken PLY header: {reason}.") from None
    if not ply.text and ply.byte_order == ">":
        raise BrokenScene(f"{path.name} is a big-endian PLY; save it as binary_little_endian or ascii.")
    return Layout(ply, counts, len(header), file_bytes)


def _header_and_counts(name: str, start: bytes, file_bytes: int) -> tuple[bytes, dict[str, int]]:
    """The header including its last line, and each element's count."""
    if not re.match(rb"ply[ \t]*\r?\n", start):
        raise BrokenScene(f"{name} is not a PLY file: it does not begin with 'ply'.")
    end = _END.search(start)
    if end is None:
        if file_bytes > MAX_HEADER:
            raise BrokenScene(f"{name} has a header of more than {MAX_HEADER // 1024} KiB; it is not a 3DGS PLY.")
        raise BrokenScene(f"{name} is truncated: its header has no 'end_header'.")
    header = start[: end.end()]
    for number, line in enumerate(header.split(b"\n"), 1):
        line = line.removesuffix(b"\r")
        if not _LINE.fullmatch(line):
            raise BrokenScene(f"{name} has a broken PLY header: line {number} is not plain ASCII text.")
        if line.split(b" ")[0] == b"element" and not _ELEMENT.fullmatch(line):
            raise BrokenScene(f"{name} has a broken PLY header: line {number} is not 'element', a name and a count.")
    counts: dict[str, int] = {}
    for match in _ELEMENT.finditer(header):
        if len(match[3]) > 18:
            raise BrokenScene(f"{name} promises an impossible number of elements: {match[3][:20].decode()}….")
        counts[match[2].decode("ascii", "replace")] = int(match[3])
    return header, counts


def _check_properties(name: str, vertex: PlyElement) -> int:
    """Check the properties of the vertices, and return the SH degree. Raises BrokenScene."""
    properties = {prop.name: prop for prop in vertex.properties}
    listed = next((prop for prop, kind in properties.items() if isinstance(kind, PlyListProperty)), None)
    if listed is not None:
        raise BrokenScene(
            f"{name} has a list as property '{listed}' of its vertices; Gaussians have plain numbers only."
        )
    missing = next((prop for prop in REQUIRED if prop not in properties), None)
    if missing is not None:
        raise BrokenScene(f"{name} is not a 3DGS PLY: its vertices have no property '{missing}'.")
    rest = sum(prop.startswith("f_rest_") for prop in properties)
    if rest not in REST_COUNTS:
        raise BrokenScene(f"{name} has {rest} properties f_rest_*; SH degree 0, 1, 2 or 3 has 0, 9, 24 or 45.")
    missing = next((f"f_rest_{i}" for i in range(rest) if f"f_rest_{i}" not in properties), None)
    if missing is not None:
        raise BrokenScene(f"{name} has {rest} properties f_rest_* but no '{missing}'.")
    return REST_COUNTS[rest]


def has_lists(element: PlyElement) -> bool:
    """Whether an element has list properties, so that its rows may differ in length."""
    return any(isinstance(prop, PlyListProperty) for prop in element.properties)


def size_problem(name: str, count: int, needed: int, file_bytes: int, *, is_exact: bool = True) -> BrokenScene:
    """The error for a file with a size that contradicts its header."""
    what = "is truncated" if file_bytes < needed else "is longer than its header says"
    least = "" if is_exact else "at least "
    return BrokenScene(f"{name} {what}: {count} vertices make {least}{needed} bytes, the file has {file_bytes}.")


def ply_header(elements: Iterable[tuple[str, int, str, Iterable[str]]], comments: Iterable[str] = ()) -> bytes:
    """The header of a binary little-endian PLY. elements: name, count, type of all properties, and their names."""
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {comment}" for comment in comments)]
    for element, count, kind, properties in elements:
        lines += [f"element {element} {count}", *(f"property {kind} {name}" for name in properties)]
    return "\n".join([*lines, "end_header", ""]).encode()


def rest_names(sh_degree: int) -> list[str]:
    """Names of the properties with a Gaussian's SH coefficients beyond the first."""
    return [f"f_rest_{i}" for i in range(3 * ((sh_degree + 1) ** 2 - 1))]


def _binary_rows(path: Path, file_bytes: int, table: Table, listener: Listener) -> Iterator[Rows]:
    for file, rows in file_blocks(path, file_bytes, table.count, listener):
        yield table.rows(file, rows.start, rows.stop)


def _ascii_rows(
    path: Path, offset: int, skip_lines: int, count: int, dtype: np.dtype[np.void], listener: Listener
) -> Iterator[Rows]:
    # NumPy's text reader, because plyfile's takes about a microsecond per number and reads the whole file at once
    with io.TextIOWrapper(open_regular(path), encoding="ascii", errors="replace") as file:
        file.seek(offset)
        lines = iter(lambda: file.readline(MAX_HEADER), "")  # bounded, because the file may have no line ends at all
        for _ in itertools.islice(lines, skip_lines):
            pass
        for rows in row_blocks(count, listener):
            some = list(itertools.islice(lines, rows.stop - rows.start))
            if rows.start + len(some) < rows.stop:
                raise BrokenScene(
                    f"{path.name} is truncated: it promises {count} vertices and has {rows.start + len(some)}."
                )
            try:
                block = np.loadtxt(some, dtype, comments=None, ndmin=1)
            except (ValueError, OverflowError) as error:
                reason = _text_error(error, rows.start)
                raise BrokenScene(f"{path.name} has a vertex that cannot be read: {reason}.") from None
            if len(block) != len(some):
                raise BrokenScene(f"{path.name} has an empty line among its vertices.")
            yield block


def _text_error(error: Exception, start: int) -> str:
    """NumPy's message about a row, which it counts from the start of the block."""
    first = str(error).split(";")[0].split(".\n")[0].rstrip(".")
    return f"{first} (counted from vertex {start})" if start else first


def _decode(rows: Callable[[Listener], Iterator[Rows]], sh_degree: int, listener: Listener) -> Iterator[Columns]:
    """Decode blocks. A Gaussian with a value that is not finite gets the opacity NaN, which drops it."""
    for block in rows(listener):
        columns = Columns(len(block), sh_degree)
        with np.errstate(all="ignore"):
            values = _values(block, REQUIRED)
            opacities = 1 / (1 + np.exp(-values[:, 6]))
            columns.means[:] = values[:, 0:3]
            columns.scales[:] = np.exp(values[:, 7:10])
            columns.quaternions[:] = normalise(values[:, 10:14])
            columns.opacities[:] = np.where(np.isfinite(values).all(1), opacities, np.nan)
            columns.sh[:, 0] = values[:, 3:6]
            rest = _values(block, rest_names(sh_degree)).reshape(len(block), 3, -1 if sh_degree else 0)
        columns.sh[:, 1:] = rest.transpose(0, 2, 1)
        yield columns


def _values(block: Rows, names: Sequence[str]) -> Floats:
    """Columns as float32, [rows, len(names)]; a double out of range becomes infinite."""
    values = np.empty((len(block), len(names)), np.float32)
    for i, name in enumerate(names):
        values[:, i] = block[name]
    return values
