"""Access by name to the files of a SOG scene: next to its meta.json, or in a zip with it, without unpacking to disk."""

from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular
from tigas_render.scenes.scene_file import translate_os_errors

META = "meta.json"
ZIP = b"PK\x03\x04"
METHODS = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
MAX_DIRECTORY = 64 * 1024
"""Maximum size in bytes of a zip's directory; nine files take about 600. Python needs a hundred times the memory."""

_END = struct.Struct("<4s4HIIH")
"""End of a zip's directory: magic, two disks, two counts, the directory's size and offset, the comment's length."""
_UNREADABLE = zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError, RuntimeError, ValueError
"""Errors that Python's zipfile raises for damaged, encrypted and unusual files."""

Read = Callable[[str, int], bytes]
"""Reads a file, by its name and maximum size in bytes. Raises BrokenScene if it is larger or cannot be read."""


@contextmanager
def open_files(path: Path, *, bundled: bool) -> Iterator[Read]:
    """Open the scene with this meta.json, or zip, as a context manager. Raises OSError, and BrokenScene if damaged."""
    if not bundled:
        yield lambda name, limit: read_file(path.with_name(path.name if name == META else name), limit)
        return
    with open_regular(path) as file:
        try:
            _check_directory(path.name, file)
            bundle = zipfile.ZipFile(file)
        except (zipfile.BadZipFile, NotImplementedError, ValueError, struct.error) as error:
            raise BrokenScene(f"{path.name} is a damaged zip: {_failure_reason(error)}.") from None
        with bundle:
            yield partial(_read_entry, path.name, bundle)


def read_file(path: Path, limit: int) -> bytes:
    """Read a file. Raises BrokenScene if it has more than `limit` bytes or cannot be read."""
    with translate_os_errors(path), open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read(min(size, limit) + 1)  # `read` allocates all of the requested size at once
    return _limit_size(path.name, content, limit)


def _read_entry(bundle_name: str, bundle: zipfile.ZipFile, name: str, limit: int) -> bytes:
    try:
        about = bundle.getinfo(name)
        if about.compress_type not in METHODS:  # with others, Python unpacks without a limit
            raise NotImplementedError("it is neither stored nor deflated")
        with bundle.open(about) as entry:
            content = entry.read(limit + 1)
    except KeyError:
        raise BrokenScene(f"{bundle_name} has no {name} in it.") from None
    except _UNREADABLE as error:
        raise BrokenScene(f"{bundle_name} has a {name} that cannot be read: {_failure_reason(error)}.") from None
    return _limit_size(name, content, limit)


def _check_directory(name: str, file: io.BufferedReader) -> None:
    """Raise BrokenScene for a zip's directory that would take much memory, before Python reads it."""
    size = file.seek(0, io.SEEK_END)
    file.seek(max(0, size - (1 << 16) - _END.size))
    tail = file.read()
    at = tail.rfind(b"PK\x05\x06")
    if at < 0 or at + _END.size > len(tail):
        raise BrokenScene(f"{name} is a truncated zip: the list of its contents is missing.")
    listed = _END.unpack_from(tail, at)[5]
    if listed > MAX_DIRECTORY or tail[max(0, at - 20) :].startswith(b"PK\x06\x07"):  # or a Zip64 directory
        raise BrokenScene(f"{name} is a zip of too many files, or too large a one, for a SOG scene.")
    file.seek(0)


def _limit_size(name: str, content: bytes, limit: int) -> bytes:
    if len(content) > limit:
        raise BrokenScene(f"{name} is larger than {limit} bytes, the maximum.")
    return content


def _failure_reason(error: Exception) -> str:
    return str(error).rstrip(".") or type(error).__name__
