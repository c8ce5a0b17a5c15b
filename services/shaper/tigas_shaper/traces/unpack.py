"""Unpacks a downloaded zip, distrusting it: no path out of its folder, no links, no more than it may hold."""

from __future__ import annotations

import stat
import tempfile
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from tigas_shaper.traces.sources import FetchError

MAX_FILES = 10_000
MAX_BYTES = 2_000_000_000


def unpack(archive: Path) -> Path:
    """The folder next to the archive, named without the suffix, with all its files; complete or absent.

    Raises FetchError for an archive that is damaged, reaches outside, or is too large, and OSError.
    """
    target = archive.with_suffix("")
    if target.exists():
        return target
    try:
        with (
            zipfile.ZipFile(archive) as content,
            tempfile.TemporaryDirectory(dir=archive.parent, prefix=".unpack-") as scratch,
        ):
            _check(archive.name, content.infolist())
            folder = Path(scratch, target.name)
            folder.mkdir()
            content.extractall(folder)
            folder.replace(target)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, FileExistsError) as error:
        raise FetchError(f"{archive.name} cannot be unpacked: {error}.") from None
    return target


def _check(archive: str, members: list[zipfile.ZipInfo]) -> None:
    # zipfile never reads more of a member than the size that its header declares
    if len(members) > MAX_FILES or sum(member.file_size for member in members) > MAX_BYTES:
        raise FetchError(f"{archive} holds more than {MAX_FILES:,} files or {MAX_BYTES // 1_000_000:,} MB.")
    if len({member.filename for member in members}) < len(members):
        raise FetchError(f"{archive} cannot be unpacked: it holds two files of one name.")
    for member in members:
        path = PurePosixPath(member.filename)
        if not path.name:
            raise FetchError(f"{archive} cannot be unpacked: it holds a file without a name.")
        if path.is_absolute() or ".." in path.parts or "\\" in member.filename or ":" in member.filename:
            raise FetchError(f"{archive} was refused: {member.filename[:100]!r} would be written elsewhere.")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise FetchError(f"{archive} was refused: {member.filename[:100]!r} is a link.")
