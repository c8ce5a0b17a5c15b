"""A reproducible archive of a report's raw runs: equal runs give equal bytes."""

from __future__ import annotations

import io
import lzma
import tarfile
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import BinaryIO

from pydantic import Field, ValidationError

from tigas_common.errors import StartError
from tigas_common.parsing import legible
from tigas_common.wire.model import WireModel
from tigas_experiments.report.run_table import LADDER, run_folders

MOST_TIMES = 1000
"""Maximum expansion: records expand ten to twenty times, zeros up to seven thousand times."""
OPTIONS = "options.json"


class Options(WireModel):
    """Contents of options.json in an archive and in its unpacked folder: options of the report."""

    baseline: str | None = None
    """A controller's name."""
    template: object = Field(default=None, exclude=True)
    """Ignored field of early archives."""


def read_options(folder: Path) -> Options:
    """Options of an unpacked archive; defaults for any other folder. Raises StartError."""
    try:
        return Options.model_validate_json((folder / OPTIONS).read_bytes())
    except FileNotFoundError:
        return Options()
    except (OSError, ValidationError) as error:
        raise StartError(f"{folder / OPTIONS} cannot be read: {' '.join(str(error).split())[:200]}") from None


def pack(folder: Path, archive: Path, options: Options) -> None:
    """Write an experiment's record, ladder, runs and options as .tar.xz, without owners, times and links.

    An existing archive is only replaced on success. Raises StartError if there are no runs, and OSError.
    """
    name = folder.resolve().name
    unfinished = archive.with_name(f".{archive.name}.part")

    def add(path: str | Path, file: BinaryIO, size: int) -> None:
        entry = tarfile.TarInfo(str(Path(name, path)))
        entry.size = size
        tar.addfile(entry, file)

    try:
        with tarfile.open(unfinished, "w:xz", format=tarfile.GNU_FORMAT) as tar:
            data = (options.model_dump_json(indent=2) + "\n").encode()
            add(OPTIONS, io.BytesIO(data), len(data))
            runs = [path for run in run_folders(folder) for path in sorted(run.rglob("*")) if not path.is_symlink()]
            for path in (folder / "experiment.json", folder / LADDER, *runs):
                if path.is_file():
                    with path.open("rb") as file:
                        add(path.relative_to(folder), file, path.stat().st_size)
        unfinished.replace(archive)
    finally:
        unfinished.unlink(missing_ok=True)


def unpack(archive: Path) -> Path:
    """Unpack an archive atomically into a folder next to it, and return the folder.

    Raises StartError if the folder exists or the file is not such an archive, and OSError.
    """
    with TemporaryDirectory(dir=archive.parent, prefix=".unpack-") as scratch:
        try:
            with tarfile.open(archive, "r:xz") as tar:
                name = _one_folder(archive, tar)
                folder = archive.parent / name
                if folder.exists():
                    raise StartError(f"{folder} exists already, so {archive} is not unpacked.")
                tar.extractall(scratch, filter="data")
        except (tarfile.TarError, lzma.LZMAError, EOFError, ValueError, OverflowError, KeyError) as error:
            raise _no_archive(archive, legible(str(error), 200)) from None
        Path(scratch, name).rename(folder)
    return folder


def _one_folder(archive: Path, tar: tarfile.TarFile) -> str:
    """Name of the single folder in an archive. Raises StartError unless `pack` could have written the archive."""
    names, room = set(), MOST_TIMES * archive.stat().st_size
    for entry in tar:
        parts = PurePosixPath(entry.name).parts
        if not entry.isreg() or len(parts) < 2 or parts[0] == "/" or ".." in parts:
            raise _no_archive(archive, f"it holds {legible(entry.name, 60)!r}, which is no file in a folder")
        names.add(parts[0])
        room -= entry.size
        if room < 0:
            raise StartError(f"{archive} would unpack to more than {MOST_TIMES:,} times its size.")
    if len(names) != 1:
        raise _no_archive(archive, "it does not hold one folder")
    return names.pop()


def _no_archive(archive: Path, why: str) -> StartError:
    return StartError(f"{archive} is not an archive of `tigas report --archive`: {why.rstrip('.')}.")
