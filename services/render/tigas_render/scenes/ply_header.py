"""The header of a 3D Gaussian Splatting PLY, validated before anything is allocated."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement, PlyListProperty, PlyParseError

from tigas_common.errors import BrokenScene
from tigas_render.scenes.scene_file import read_start

MAX_HEADER = 64 * 1024
"""The longest header, in bytes; one with SH degree 3 takes about 1,500."""

REST_COUNTS = {0: 0, 9: 1, 24: 2, 45: 3}
"""Number of f_rest_* properties to SH degree: 3 · ((degree + 1)² − 1)."""

ANTIALIASED = "SplatRenderMode: mip"
"""Brush's comment for that."""

REQUIRED = (
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)

_END = re.compile(rb"^end_header *\r?\n", re.MULTILINE)
_LINE = re.compile(rb" *|[!-~][ -~]*|(comment|obj_info)[\t -~]*")
"""Without its end. plyfile takes more for white space, and would see elements where `_ELEMENT` sees none."""
_ELEMENT = re.compile(rb"^(element +([!-~]+) +)([0-9]+) *(\r?)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class PlyHeader:
    """Facts about a PLY from its header and its size, including the offset of its vertices."""

    count: int
    """Number of Gaussians, at least 1."""
    sh_degree: int
    """0 to 3."""
    file_bytes: int
    ascii: bool
    offset: int
    """Binary: bytes before the first vertex. ASCII: bytes before the first line of data."""
    skip_lines: int
    """ASCII: lines of other elements before the first vertex."""
    dtype: np.dtype[np.void]
    """One vertex; little-endian if binary."""
    antialiased: bool
    """Whether a comment says that it was trained with Mip-Splatting's 2D filter."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Offsets of the elements of any PLY."""

    ply: PlyData
    """Without any data."""
    counts: dict[str, int]
    """Of each element."""
    data_offset: int
    """Bytes before the first element."""
    file_bytes: int


def read_header(path: Path) -> PlyHeader:
    """Read and check a file's header; reads at most MAX_HEADER bytes and trusts no size in them.

    Raises BrokenScene, with one sentence, if the file is not an INRIA 3DGS PLY of the announced size.
    """
    layout = read_layout(path)
    ply, counts, offset, file_bytes = layout.ply, layout.counts, layout.data_offset, layout.file_bytes
    if "vertex" not in ply:
        raise BrokenScene(f"{path.name} has no element 'vertex', so it holds no Gaussians.")
    vertex, count = ply["vertex"], counts["vertex"]
    sh_degree = _check_properties(path.name, vertex)
    if count == 0:
        raise BrokenScene(f"{path.name} has 0 vertices, so there is nothing to show.")
    dtype = vertex.dtype("=" if ply.text else "<")
    antialiased = says_antialiased(ply.comments)
    before = ply.elements[: ply.elements.index(vertex)]
    if ply.text:
        skip_lines = sum(counts[element.name] for element in before)
        needed = offset + 2 * (skip_lines + count * len(vertex.properties)) - 1  # a digit and a separator each
        if file_bytes < needed:
            raise BrokenScene(size_problem(path.name, count, "at least ", needed, file_bytes))
        return PlyHeader(count, sh_degree, file_bytes, True, offset, skip_lines, dtype, antialiased)
    for element in before:
        if has_lists(element):
            raise BrokenScene(f"{path.name} has lists in element '{element.name}' before its vertices; put them after.")
        offset += counts[element.name] * element.dtype("<").itemsize
    needed = offset + count * dtype.itemsize
    after = ply.elements[len(before) + 1 :]
    if not any(map(has_lists, after)):
        needed += sum(counts[element.name] * element.dtype("<").itemsize for element in after)
        if file_bytes != needed:
            raise BrokenScene(size_problem(path.name, count, "", needed, file_bytes))
    elif file_bytes < needed:
        raise BrokenScene(size_problem(path.name, count, "at least ", needed, file_bytes))
    return PlyHeader(count, sh_degree, file_bytes, False, offset, 0, dtype, antialiased)


def read_layout(path: Path) -> Layout:
    """Read the header of any PLY but a big-endian one; reads at most MAX_HEADER bytes. Raises BrokenScene."""
    start, file_bytes = read_start(path, MAX_HEADER)
    header, counts = _header_and_counts(path.name, start, file_bytes)
    try:
        # plyfile would continue with the elements, so it gets an empty file
        ply = PlyData.read(io.BytesIO(_ELEMENT.sub(rb"\g<1>0\4", header)))
    except (PlyParseError, ValueError, UnicodeDecodeError) as error:
        reason = textwrap.shorten(str(error), 120, placeholder=" …").rstrip(".")
        raise BrokenScene(f"{path.name} has a broken PLY header: {reason}.") from None
    if not ply.text and ply.byte_order == ">":
        raise BrokenScene(f"{path.name} is a big-endian PLY; save it as binary_little_endian or ascii.")
    return Layout(ply, counts, len(header), file_bytes)


def says_antialiased(comments: Iterable[str]) -> bool:
    """Whether it was trained with Mip-Splatting's 2D filter, as Brush and Postshot say it; the last word counts."""
    said = False
    for comment in comments:
        match comment.lower().split():
            case ["splatrendermode:", mode]:
                said = mode == "mip"
            case ["antialiased", flag]:  # Postshot's
                said = flag == "1"
    return said


def _header_and_counts(name: str, start: bytes, file_bytes: int) -> tuple[bytes, dict[str, int]]:
    """The header up to and with its last line, and each element's count."""
    if not start:
        raise BrokenScene(f"{name} is empty.")
    if not re.match(rb"ply[ \t]*\r?\n", start):
        raise BrokenScene(f"{name} is not a PLY file: it does not begin with 'ply'.")
    end = _END.search(start)
    if end is None:
        if file_bytes > MAX_HEADER:
            raise BrokenScene(f"{name} has a header of more than {MAX_HEADER // 1024} KiB; that is no 3DGS PLY.")
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
    """The SH degree, after a look at the vertices' properties."""
    properties = {prop.name: prop for prop in vertex.properties}
    if has_lists(vertex):
        listed = next(prop.name for prop in vertex.properties if isinstance(prop, PlyListProperty))
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
    """Whether its rows are of different lengths."""
    return any(isinstance(prop, PlyListProperty) for prop in element.properties)


def size_problem(name: str, count: int, at_least: str, needed: int, file_bytes: int) -> str:
    """Message about a file with another size than its header announces."""
    what = "is truncated" if file_bytes < needed else "is longer than its header says"
    return f"{name} {what}: {count} vertices make {at_least}{needed} bytes, the file has {file_bytes}."
