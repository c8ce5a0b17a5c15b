"""The files of a SOG scene by name: next to its meta.json, or in one zip with it. Nothing is unpacked to disk."""

from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Self

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular

META = "meta.json"
ZIP = b"PK\x03\x04"
METHODS = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
MAX_DIRECTORY = 64 * 1024
"""Bytes of a bundle's list of contents; nine files take about 600. Python takes a hundred times as much for them."""

_END = struct.Struct("<4s4HIIH")
"""Of a zip: magic, two disks, two counts, the list's size and offset, the comment's length."""
_UNREADABLE = zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError, RuntimeError, ValueError
"""Errors of Python's zipfile for damaged, encrypted and unusual files in a zip."""


class SogFiles(ABC):
    """A context manager that closes the files it opened."""

    path: Path
    """The file that was opened first."""

    @abstractmethod
    def read(self, name: str, limit: int) -> bytes:
        """A file's content. Raises BrokenScene if it has more than `limit` bytes, or cannot be read."""

    @abstractmethod
    def paths(self, names: tuple[str, ...]) -> tuple[Path, ...]:
        """On disk, of the scene with images of these names."""

    def close(self) -> None:  # noqa: B027 - a folder keeps nothing open
        """Close all open files."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Folder(SogFiles):
    """A meta.json with its images next to it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self, name: str, limit: int) -> bytes:
        path = self.path if name == META else self.path.with_name(name)
        try:
            with open_regular(path) as file:
                size = os.fstat(file.fileno()).st_size
                content = file.read(min(size, limit) + 1)  # memory for all that it asks for is taken at once
        except OSError as error:
            raise BrokenScene(f"{path.name} cannot be read: {error.strerror or error}.") from None
        return _within(path.name, content, limit)

    def paths(self, names: tuple[str, ...]) -> tuple[Path, ...]:
        return (self.path, *(self.path.with_name(name) for name in dict.fromkeys(names)))


class Bundle(SogFiles):
    """A zip with a meta.json and its images."""

    def __init__(self, path: Path) -> None:
        """Raises BrokenScene and OSError."""
        self.path = path
        file = open_regular(path)
        try:
            _check_directory(path.name, file)
            self._zip = zipfile.ZipFile(file)
        except (zipfile.BadZipFile, NotImplementedError, ValueError, struct.error) as error:
            file.close()
            raise BrokenScene(f"{path.name} is a damaged zip: {_reason(error)}.") from None
        except BaseException:
            file.close()
            raise
        self._file = file

    def read(self, name: str, limit: int) -> bytes:
        try:
            about = self._zip.getinfo(name)
            if about.compress_type not in METHODS:  # of others, Python unpacks all that it has read at once
                raise NotImplementedError("it is neither stored nor deflated")
            with self._zip.open(about) as entry:
                content = entry.read(limit + 1)
        except KeyError:
            raise BrokenScene(f"{self.path.name} has no {name} in it.") from None
        except _UNREADABLE as error:
            raise BrokenScene(f"{self.path.name} has a {name} that cannot be read: {_reason(error)}.") from None
        return _within(name, content, limit)

    def paths(self, names: tuple[str, ...]) -> tuple[Path, ...]:
        return (self.path,)

    def close(self) -> None:
        self._zip.close()
        self._file.close()


def _check_directory(name: str, file: io.BufferedReader) -> None:
    """Refuse a list of contents that would take much memory, before Python reads it."""
    size = file.seek(0, io.SEEK_END)
    file.seek(max(0, size - (1 << 16) - _END.size))
    tail = file.read()
    at = tail.rfind(b"PK\x05\x06")
    if at < 0 or at + _END.size > len(tail):
        raise BrokenScene(f"{name} is a truncated zip: the list of its contents is missing.")
    listed = _END.unpack_from(tail, at)[5]
    if listed > MAX_DIRECTORY or tail[max(0, at - 20) :].startswith(b"PK\x06\x07"):  # the second: a list elsewhere
        raise BrokenScene(f"{name} is a zip of too many files, or too large a one, for a SOG scene.")
    file.seek(0)


def _within(name: str, content: bytes, limit: int) -> bytes:
    if len(content) > limit:
        raise BrokenScene(f"{name} is larger than {limit} bytes, which is more than it can need.")
    return content


def _reason(error: Exception) -> str:
    return str(error).rstrip(".") or type(error).__name__
