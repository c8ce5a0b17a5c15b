"""A reproducible archive of the raw runs of one or more experiments: equal runs give equal bytes."""

from __future__ import annotations

import hashlib
import io
import lzma
import tarfile
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import BinaryIO

from pydantic import Field, ValidationError

from tigas_common.errors import StartError
from tigas_common.parsing import quotable
from tigas_common.wire.model import WireModel
from tigas_experiments.records.folder import LADDER
from tigas_experiments.report.figures import FIGURE_FILES
from tigas_experiments.report.run_table import RUNS, run_folders

MOST_TIMES = 1000
"""Maximum expansion: records expand ten to twenty times, zeros up to seven thousand times."""
OPTIONS = "options.json"
DIGESTS = "SHA256SUMS"
"""File with the digests of the tables and figures made from the runs."""
TABLE_FILES = (
    *(f"{name}.csv" for name in ("runs", "groups", "picture_scores", "differences", "equal_rates", "ladder")),
    *(f"{name}.md" for name in ("table", "overall", "best")),
)
PICTURES = ("captures", "samples")
"""Folders with a run's pictures, which tables and figures do not need, as their quality is in the records."""


class Options(WireModel):
    """The content of options.json in an archive and its unpacked folder: options of the report."""

    baseline: str | None = None
    """Name of a controller."""
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


def find_experiments(folder: Path) -> list[Path]:
    """The folder itself if it is an experiment's, or else the experiments in it, sorted by name."""
    if (folder / RUNS).is_dir() or not folder.is_dir():
        return [folder]
    return [path for path in sorted(folder.iterdir()) if (path / RUNS).is_dir()] or [folder]


def compute_digests(folder: Path) -> dict[str, str]:
    """SHA-256 of the tables and figures in a folder and in its experiments, by path."""
    folders = {folder, *find_experiments(folder)}
    found = sorted(path for each in folders for kind in (*TABLE_FILES, *FIGURE_FILES) for path in each.glob(kind))
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in found}


def find_changed(folder: Path) -> list[str]:
    """The tables and figures in the folder of an unpacked archive that differ from the archived ones."""
    lines = (folder / DIGESTS).read_text(encoding="utf-8").splitlines()
    archived = {path: digest for digest, _, path in (line.partition("  ") for line in lines)}
    return sorted({path for path, _ in archived.items() ^ compute_digests(folder).items()})


def pack(folder: Path, archive: Path, options: Mapping[Path, Options], *, pictures: bool = True) -> None:
    """Write records, ladders, runs and options of all experiments in a folder, and the digests of their tables and
    figures, as .tar.xz without owners, times and links. Files of folders next to the experiments are included.

    An existing archive is only replaced on success. Raises StartError if there are no runs, and OSError.
    """
    unfinished = archive.with_name(f".{archive.name}.part")

    def add(path: Path, file: BinaryIO, size: int) -> None:
        entry = tarfile.TarInfo(str(folder.resolve().name / path.relative_to(folder)))
        entry.size = size
        tar.addfile(entry, file)

    def add_text(path: Path, text: str) -> None:
        add(path, io.BytesIO(text.encode()), len(text.encode()))

    try:
        with tarfile.open(unfinished, "w:xz", format=tarfile.GNU_FORMAT) as tar:
            for each in find_experiments(folder):
                add_text(each / OPTIONS, options[each].model_dump_json(indent=2) + "\n")
            add_text(
                folder / DIGESTS, "".join(f"{digest}  {path}\n" for path, digest in compute_digests(folder).items())
            )
            for path in _raw_files(folder, pictures=pictures):
                with path.open("rb") as file:
                    add(path, file, path.stat().st_size)
        unfinished.replace(archive)
    finally:
        unfinished.unlink(missing_ok=True)


def _raw_files(folder: Path, *, pictures: bool) -> Iterator[Path]:
    for each in find_experiments(folder):
        files = (each / "experiment.json", each / LADDER, each / "ladder.csv")
        runs = (path for run in run_folders(each) for path in sorted(run.rglob("*")))
        for path in (*files, *runs):
            if path.is_file() and not path.is_symlink() and (pictures or path.parent.name not in PICTURES):
                yield path
    if not (folder / RUNS).is_dir():
        for path in sorted(folder.glob("*/*")):
            if path.is_file() and not path.is_symlink() and not (path.parent / RUNS).is_dir():
                yield path


def unpack(archive: Path) -> Path:
    """Unpack an archive atomically into a folder next to it, and return the folder.

    Raises StartError if the folder exists or the file is not such an archive, and OSError.
    """
    with TemporaryDirectory(dir=archive.parent, prefix=".unpack-") as scratch:
        try:
            with tarfile.open(archive, "r:xz") as tar:
                name = _archive_folder(archive, tar)
                folder = archive.parent / name
                if folder.exists():
                    raise StartError(f"{folder} already exists, so {archive} was not unpacked.")
                tar.extractall(scratch, filter="data")
        except (tarfile.TarError, lzma.LZMAError, EOFError, ValueError, OverflowError, KeyError) as error:
            raise _archive_error(archive, quotable(str(error), 200)) from None
        Path(scratch, name).rename(folder)
    return folder


def _archive_folder(archive: Path, tar: tarfile.TarFile) -> str:
    """Name of the single folder in an archive. Raises StartError unless `pack` could have written the archive."""
    names, room = set(), MOST_TIMES * archive.stat().st_size
    for entry in tar:
        parts = PurePosixPath(entry.name).parts
        if not entry.isreg() or len(parts) < 2 or parts[0] == "/" or ".." in parts:
            raise _archive_error(archive, f"it holds {quotable(entry.name, 60)!r}, which is not a file in a folder")
        names.add(parts[0])
        room -= entry.size
        if room < 0:
            raise StartError(f"{archive} would unpack to more than {MOST_TIMES:,} times its size.")
    if len(names) != 1:
        raise _archive_error(archive, "it does not hold one folder")
    return names.pop()


def _archive_error(archive: Path, why: str) -> StartError:
    return StartError(f"{archive} is not an archive of `tigas report --archive`: {why.rstrip('.')}.")
