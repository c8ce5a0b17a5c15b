"""Reads SPZ files: compressed columns of small integers, about a tenth of the size of a PLY.

The format (https://github.com/nianticlabs/spz): versions 2 and 3 are one gzip stream, including a header of 16 bytes;
version 4 has a header of 32 bytes and a table, followed by one Zstandard stream per column. Positions are fixed-point
numbers of 24 bits; scales (logarithms) and colours have 8 bits, quaternions 24 or 32. The axes are used unchanged: the
file does not name them, and the tools that write it do not convert them.

No column is kept in memory: all are unpacked in parallel, each from its own offset, up to which a gzip stream has to be
unpacked again for each column.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import zstandard
from numpy.typing import NDArray

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular
from tigas_render.scenes.scene_file import (
    Columns,
    Floats,
    Listener,
    SceneFile,
    add_largest,
    check_packed_count,
    normalise,
    row_blocks,
)

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

MAGIC = b"NGSP"
GZIP = b"\x1f\x8b"
COLOUR_SCALE = 0.15
"""Scale of the first coefficient: a byte spans 1 / 0.15, since other coefficients may bring colours back to 0 to 1."""
MAX_FRACTIONAL_BITS = 24
PACKED_BYTES = 1 << 16

_HEADER = struct.Struct("<4sIIBBBB")
_TABLE = struct.Struct("<I12x")
_ENTRY = struct.Struct("<QQ")
_ANTIALIASED, _EXTENSIONS = 1, 2

_Bytes = NDArray[np.uint8]


class _Stream(Protocol):
    def read(self, size: int, /) -> bytes: ...


class _FileView(io.RawIOBase):
    """A view of a file from an offset, with an independent position."""

    def __init__(self, file: io.BufferedReader, at: int) -> None:
        self._file = file
        self._at = at

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: WriteableBuffer, /) -> int:
        count = os.preadv(self._file.fileno(), [buffer], self._at)
        self._at += count
        return count


class _GzipReader:
    """A gzip stream, unpacked on demand. Python's own reader would read a header of any length byte by byte."""

    def __init__(self, file: io.BufferedReader) -> None:
        self._file = file
        self._zlib = zlib.decompressobj(16 + zlib.MAX_WBITS)

    def read(self, size: int, /) -> bytes:
        """Read up to `size` bytes; empty at the end. Raises EOFError and zlib.error."""
        while not self._zlib.eof:
            packed = self._zlib.unconsumed_tail or self._file.read(PACKED_BYTES)
            if content := self._zlib.decompress(packed, size):
                return content
            if not packed:
                raise EOFError("its gzip stream has no end")
        return b""


@dataclass(frozen=True, slots=True)
class _Header:
    version: int
    count: int
    sh_degree: int
    fractional_bits: int
    starts: tuple[int, ...] = ()
    """Offsets of the columns, in version 4."""

    @property
    def widths(self) -> dict[int, int]:
        """Bytes per Gaussian by column: position, opacity, colour, scale, rotation, other coefficients."""
        widths = (9, 1, 3, 3, 3 if self.version == 2 else 4, 3 * ((self.sh_degree + 1) ** 2 - 1))
        return {column: width for column, width in enumerate(widths) if width}


def read_spz(path: Path) -> SceneFile:
    """Describe a file. Raises OSError, and BrokenScene, with one sentence, if its header is unreadable."""
    with _open(path) as file:
        file_bytes = file.seek(0, io.SEEK_END)
        file.seek(0)
        header, antialiased = _read_header(path.name, file, file_bytes)
    decode = partial(_decode, path, header)
    return SceneFile(f"SPZ {header.version}", (path,), header.count, header.sh_degree, file_bytes, decode, antialiased)


def _decode(path: Path, header: _Header, listener: Listener) -> Iterator[Columns]:
    with _open(path) as file:
        streams = _column_streams(path.name, file, header)
        for block in row_blocks(header.count, listener):
            rows = block.stop - block.start
            columns = Columns(rows, header.sh_degree)
            for (column, width), stream in zip(header.widths.items(), streams, strict=True):
                content = np.frombuffer(_read_exactly(path.name, stream, rows * width), np.uint8)
                _fill(columns, column, content.reshape(rows, width), header)
            yield columns


def _column_streams(name: str, file: io.BufferedReader, header: _Header) -> list[_Stream]:
    """A reader for each column."""
    if header.version == 4:
        return [zstandard.ZstdDecompressor().stream_reader(_reader_at(file, start)) for start in header.starts]
    streams: list[_Stream] = []
    skipped = _HEADER.size
    for width in header.widths.values():
        streams.append(_GzipReader(_reader_at(file, 0)))
        for start in range(0, skipped, PACKED_BYTES):
            _read_exactly(name, streams[-1], min(PACKED_BYTES, skipped - start))
        skipped += width * header.count
    return streams


@contextmanager
def _open(path: Path) -> Iterator[io.BufferedReader]:
    try:
        with open_regular(path) as file:
            yield file
    except (EOFError, zlib.error, zstandard.ZstdError) as error:
        raise BrokenScene(f"{path.name} is damaged: {str(error).rstrip('.')}.") from None


def _reader_at(file: io.BufferedReader, at: int) -> io.BufferedReader:
    return io.BufferedReader(_FileView(file, at), PACKED_BYTES)


def _read_header(name: str, file: io.BufferedReader, file_bytes: int) -> tuple[_Header, bool]:
    """The header, perhaps in a gzip stream, and whether the scene was trained antialiased."""
    packed = file.read(2) == GZIP
    file.seek(0)
    magic, version, count, sh_degree, fractional_bits, flags, streams = _HEADER.unpack(
        _read_exactly(name, _GzipReader(file) if packed else file, _HEADER.size)
    )
    if magic != MAGIC:
        raise BrokenScene(f"{name} is not SPZ: it does not begin with {MAGIC.decode()!r}.")
    if version not in (2, 3, 4) or (version == 4) == packed:
        raise BrokenScene(f"{name} has version {version} of SPZ; 2 and 3 in gzip, and 4, can be read.")
    if sh_degree > 3:
        raise BrokenScene(f"{name} has SH degree {sh_degree}; 0 to 3 can be read.")
    if fractional_bits > MAX_FRACTIONAL_BITS:
        raise BrokenScene(f"{name} has {fractional_bits} fractional bits in its positions, which have 24.")
    if flags & _EXTENSIONS:
        raise BrokenScene(f"{name} has extensions of SPZ, which cannot be read; export it without them.")
    check_packed_count(name, count, file_bytes)
    header = _Header(version, count, sh_degree, fractional_bits)
    if version == 4:
        header = replace(header, starts=_offsets(name, file, header, streams, file_bytes))
    return header, bool(flags & _ANTIALIASED)


def _offsets(name: str, file: io.BufferedReader, header: _Header, streams: int, file_bytes: int) -> tuple[int, ...]:
    """Check the table of columns of version 4, and return their offsets. Raises BrokenScene."""
    file.seek(_HEADER.size)
    (table,) = _TABLE.unpack(_read_exactly(name, file, _TABLE.size))
    if streams != len(header.widths):
        raise BrokenScene(f"{name} has {streams} streams where {len(header.widths)} belong.")
    file.seek(table)
    entries = [_ENTRY.unpack(_read_exactly(name, file, _ENTRY.size)) for _ in header.widths]
    start, starts = file.tell(), []
    for width, (packed, unpacked) in zip(header.widths.values(), entries, strict=True):
        if unpacked != width * header.count:
            raise BrokenScene(f"{name} has a stream of {unpacked} bytes where {width * header.count} belong.")
        starts.append(start)
        start += packed
    if start > file_bytes:
        raise BrokenScene(f"{name} is truncated: its streams end at byte {start}, the file has {file_bytes}.")
    return tuple(starts)


def _read_exactly(name: str, stream: _Stream, size: int) -> bytes:
    parts: list[bytes] = []
    while size > 0:
        part = stream.read(size)
        if not part:
            raise BrokenScene(f"{name} is truncated: it ends before all of its Gaussians.")
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def _fill(columns: Columns, column: int, content: _Bytes, header: _Header) -> None:
    """Decode the bytes [rows, width] of the column with this number."""
    if column == 0:
        wide = content.reshape(-1, 3, 3).astype(np.int32)
        fixed = wide[..., 0] | wide[..., 1] << 8 | wide[..., 2] << 16
        columns.means[:] = np.where(fixed >= 1 << 23, fixed - (1 << 24), fixed) / 2.0**header.fractional_bits
    elif column == 1:
        columns.opacities[:] = content[:, 0] / np.float32(255)
    elif column == 2:
        columns.sh[:, 0] = (content / np.float32(255) - 0.5) / COLOUR_SCALE
    elif column == 3:
        columns.scales[:] = np.exp(content / np.float32(16) - 10)
    elif column == 4:
        columns.quaternions[:] = _first_three(content) if header.version == 2 else _smallest_three(content)
    else:
        columns.sh[:, 1:] = (content.reshape(len(content), -1, 3).astype(np.float32) - 128) / 128


def _first_three(content: _Bytes) -> Floats:
    """Quaternions w, x, y, z from x, y, z in one byte each, where w is not negative."""
    xyz = content / 127.5 - 1
    w = np.sqrt(np.maximum(0, 1 - (xyz**2).sum(1)))
    return normalise(np.column_stack((w, xyz)))


def _smallest_three(content: _Bytes) -> Floats:
    """Quaternions w, x, y, z from the index of the largest of x, y, z, w in two bits, and the others in ten each."""
    words = np.ascontiguousarray(content).view("<u4")[:, 0]
    fields: NDArray[Any] = words[:, None] >> np.array([20, 10, 0], np.uint32) & 1023
    size = (fields & 511) / (511 * np.sqrt(2))
    xyzw = add_largest(np.where(fields & 512, -size, size), words >> 30)
    return xyzw[:, [3, 0, 1, 2]]
