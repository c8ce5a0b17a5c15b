"""Downloads of published trace sets: the list in sources.toml, the files, and untrusted archives."""

from __future__ import annotations

import lzma
import re
import stat
import tempfile
import tomllib
import zipfile
import zlib
from importlib.resources import files
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from tigas_common.downloads import FetchError

ARCHIVE_ERRORS = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError)
MAX_BYTES = 1_000_000_000
"""Maximum size of a file; a server that never stops must not fill the disk."""
MAX_UNPACKED_FILES = 10_000
MAX_UNPACKED_BYTES = 2_000_000_000
_SAFE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+=-]{0,99}")


class SourceFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    url: str
    sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    """Checksum of the file; None if none has been published or verified."""

    @property
    def name(self) -> str:
        """File name on disk: the last part of the URL."""
        return unquote(urlsplit(self.url).path).rpartition("/")[2]


class Source(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str
    page: str
    licence: str
    cite: str
    files: tuple[SourceFile, ...] = Field(min_length=1)


def load_sources(path: Path | None = None) -> dict[str, Source]:
    """The sets by name, from a TOML file or the built-in list. Raises FetchError and OSError."""
    text = path.read_text("utf-8") if path else files("tigas_shaper.traces").joinpath("sources.toml").read_text("utf-8")
    try:
        sources = TypeAdapter(dict[str, Source]).validate_python(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, ValidationError) as error:
        raise FetchError(f"The list of trace sets cannot be read: {str(error).splitlines()[0]}.") from None
    for name, source in sources.items():
        for part in (name, *(file.name for file in source.files)):
            if not _SAFE_NAME.fullmatch(part):
                raise FetchError(f"{part[:60]!r} in the list of trace sets cannot be the name of a file.")
        for file in source.files:
            if urlsplit(file.url).scheme not in ("http", "https"):
                raise FetchError(f"{file.url[:100]!r} in the list of trace sets is not an HTTP address.")
    return sources


def unpack(archive: Path) -> Path:
    """Unpack an archive into a folder next to it, named without the suffix. The folder is complete or absent.

    Raises OSError, and FetchError for an archive that is damaged, too large, or writes outside the folder.
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
    except (*ARCHIVE_ERRORS, NotImplementedError, RuntimeError, FileExistsError) as error:
        raise FetchError(f"{archive.name} cannot be unpacked: {error}.") from None
    return target


def _check(archive: str, members: list[zipfile.ZipInfo]) -> None:
    # zipfile never reads more of a member than the size in its header
    if len(members) > MAX_UNPACKED_FILES or sum(member.file_size for member in members) > MAX_UNPACKED_BYTES:
        megabytes = MAX_UNPACKED_BYTES // 1_000_000
        raise FetchError(f"{archive} holds more than {MAX_UNPACKED_FILES:,} files or {megabytes:,} MB.")
    if len({member.filename for member in members}) < len(members):
        raise FetchError(f"{archive} cannot be unpacked: it has two files of the same name.")
    for member in members:
        path = PurePosixPath(member.filename)
        if not path.name:
            raise FetchError(f"{archive} cannot be unpacked: it holds a file without a name.")
        if path.is_absolute() or ".." in path.parts or "\\" in member.filename or ":" in member.filename:
            raise FetchError(f"{archive} was refused: {member.filename[:100]!r} would be written elsewhere.")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise FetchError(f"{archive} was refused: {member.filename[:100]!r} is a link.")
