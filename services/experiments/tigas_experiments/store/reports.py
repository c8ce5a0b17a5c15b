"""Reports of experiments, made on demand and cached until runs change, and ZIPs, made while they are sent."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZIP_STORED

from zipstream import ZipStream

from tigas_common.errors import StartError
from tigas_common.files import read_regular
from tigas_common.offload import Offload
from tigas_experiments.records.folder import LADDER
from tigas_experiments.store.errors import NothingToReport, UnknownExperiment, storage_errors
from tigas_experiments.store.experiments import Experiments, file_version, list_runs, run_version
from tigas_experiments.store.metrics import MonitoredLock
from tigas_experiments.store.workspace import Workspace

LEVEL = 5
"""Records shrink to about a tenth; a higher level would take time that the services need."""
COMPRESSED = (".png", ".jpg", ".webp")
"""Suffixes of files to store without further compression."""
REPORT = "report.html"
MAX_REPORT_BYTES = 1_000_000_000
"""Usually, reports have a few megabytes."""
Versions = tuple[tuple[str, tuple[int, ...] | None], ...]


class Reports:
    """Makes reports one at a time, as each takes a processor."""

    def __init__(self, experiments: Experiments, workspace: Workspace, offload: Offload) -> None:
        self._experiments = experiments
        self._workspace = workspace
        self._offload = offload
        self.lock = MonitoredLock()
        self._made: dict[str, Versions] = {}
        """Versions of the runs and the ladder in each cached report."""

    async def html(self, experiment: str) -> bytes:
        """The report as HTML, also written into the experiment's folder. May take seconds.

        Raises UnknownExperiment, NothingToReport and DiskFull.
        """
        async with self.lock:
            folder, _ = await asyncio.to_thread(self._experiments.find, experiment)
            runs = await asyncio.to_thread(list_runs, folder)
            if not runs:
                raise NothingToReport("The experiment has no runs yet.")
            versions = await asyncio.to_thread(_versions, folder, runs)
            with storage_errors(), _require_exists(experiment):
                if self._made.get(experiment) != versions or not (folder / REPORT).is_file():
                    with self._workspace.folder() as made:
                        await self._offload(write_report_files, folder, made)
                        await asyncio.to_thread(_move, made, folder)
                    self._made[experiment] = versions
                return await asyncio.to_thread(read_regular, folder / REPORT, MAX_REPORT_BYTES)


def _versions(folder: Path, runs: Sequence[Path]) -> Versions:
    return (*((run.name, run_version(run)) for run in runs), (LADDER, file_version(folder / LADDER)))


@contextmanager
def _require_exists(experiment: str) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise UnknownExperiment(f"The experiment {experiment} has been removed.") from None


def write_report_files(folder: Path, out: Path) -> None:
    """Write an experiment's report into `out`, and remove the files of an earlier one from the experiment's folder.

    Raises NothingToReport and DiskFull.
    """
    from tigas_experiments.report.report import clear, write_report  # heavy, and only needed in the process that draws

    with storage_errors():
        try:
            write_report(folder, out)
            clear(folder)
        except StartError as error:
            raise NothingToReport(str(error)) from None


def _move(made: Path, folder: Path) -> None:
    for path in made.iterdir():
        path.replace(folder / path.name)


def archive(folder: Path) -> Iterator[bytes]:
    """Yield the ZIP of a folder, with its name and without links.

    Raises OSError if the folder is removed meanwhile.
    """
    stream = ZipStream(compress_type=ZIP_DEFLATED, compress_level=LEVEL)
    for parent, folders, names in os.walk(folder, onerror=_raise):
        folders.sort()
        inside = Path(folder.name, Path(parent).relative_to(folder))
        stream.add_path(parent, str(inside), recurse=False)
        for name in sorted(names):
            path = Path(parent, name)
            if path.is_file() and not path.is_symlink():
                stored = path.suffix in COMPRESSED
                stream.add_path(
                    path, str(inside / name), recurse=False, compress_type=ZIP_STORED if stored else ZIP_DEFLATED
                )
    yield from stream


def _raise(error: OSError) -> None:
    raise error
