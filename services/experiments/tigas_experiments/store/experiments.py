"""Experiments of pages and commands as folders in one directory: listed, created, extended and removed.

All functions block, so the application calls them in threads. An experiment's id is its folder's name. Links are not
followed, so that nothing outside the directory can be reached.
"""

from __future__ import annotations

import errno
import itertools
import re
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from tigas_common.errors import StartError, StorageFailed
from tigas_common.files import flush_folder
from tigas_experiments.lock import LOCK_NAME, hold_lock
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import ExperimentRecord, RunRecord, StoredRun, read_experiment
from tigas_experiments.records.samples import INDEX as SAMPLES
from tigas_experiments.records.samples import RERENDERED
from tigas_experiments.records.scores import SCORES
from tigas_experiments.records.summary import summarise
from tigas_experiments.store.errors import ExperimentInUse, UnknownExperiment, UnknownRun, storage_errors
from tigas_experiments.store.samples import count_samples
from tigas_experiments.store.workspace import Workspace
from tigas_experiments.wire.store import LONGEST_NAME, Experiment, ExperimentList, ExperimentSummary, RunRow

CACHED_RUNS = 10_000
T = TypeVar("T")
NAME_TAKEN_ERRORS = (errno.EEXIST, errno.ENOTEMPTY, errno.ENOTDIR)
"""Error numbers for an existing target."""


class Experiments:
    def __init__(self, results: Path, workspace: Workspace) -> None:
        self.results = results.resolve()
        """Directory with the experiments' folders."""
        self._workspace = workspace

    def all(self) -> ExperimentList:
        found = []
        for folder, record in self._read():
            runs = list(_read(_record, folder))
            found.append(
                ExperimentSummary(
                    id=folder.name,
                    **record.model_dump(include={"name", "created", "source", "planned"}),
                    runs=len(runs),
                    complete=sum(run.status == "complete" for run in runs),
                    sampled=sum((run / SAMPLES).is_file() for run in list_runs(folder)),
                )
            )
        return ExperimentList(experiments=tuple(sorted(found, key=lambda one: (one.created, one.id), reverse=True)))

    def get(self, experiment: str) -> Experiment:
        """An experiment with its runs. Raises UnknownExperiment."""
        folder, record = self.find(experiment)
        runs = list(_read(_row_of, folder))
        return Experiment(
            id=experiment,
            **record.model_dump(include={"name", "created", "source", "plan"}),
            complete=sum(run.status == "complete" for run in runs),
            runs=tuple(runs),
        )

    def find(self, experiment: str) -> tuple[Path, ExperimentRecord]:
        """Folder and record of an experiment. Raises UnknownExperiment."""
        folder = self.results / experiment
        # Compared by name, as a path could lead anywhere.
        if folder.name != experiment or not _is_folder(folder):
            raise UnknownExperiment(f"There is no experiment {experiment[:100]!r}.")
        try:
            return folder, read_experiment(folder)
        except BrokenRecording:
            raise UnknownExperiment(f"The folder {experiment} has no experiment.json that can be read.") from None

    def run(self, experiment: str, name: str) -> Path:
        """The folder of a run. Raises UnknownExperiment and UnknownRun."""
        runs = self.find(experiment)[0] / "runs"
        folder = runs / name
        if folder.name != name or not (_is_folder(runs) and _is_folder(folder)):
            raise UnknownRun(f"The experiment {experiment} has no run {name[:100]!r}.")
        return folder

    def page_run(self, experiment: str, name: str) -> Path:
        """The folder of a run in an experiment that pages may change. Also raises ExperimentInUse."""
        self.find_page(experiment)
        return self.run(experiment, name)

    def create(self, made: Path, name: str) -> str:
        """Move a complete experiment from the workspace to its place, and return its id. Raises DiskFull."""
        slug = re.sub(r"[^A-Za-z0-9.-]+", "-", name).strip(".-")[:60] or "experiment"
        with storage_errors():
            return _move_to_place(made, self.results, f"{slug}-{datetime.now(UTC):%Y%m%d-%H%M%S}")

    def _read(self) -> Iterator[tuple[Path, ExperimentRecord]]:
        """Folders and records of all readable experiments."""
        with storage_errors():
            folders = [path for path in self.results.iterdir() if _is_folder(path)]
        for folder in folders:
            try:
                yield folder, read_experiment(folder)
            except BrokenRecording:
                continue

    def unused_name(self, name: str) -> str:
        """The name, or the first unused one of `NAME (2)`, `NAME (3)`, …; long names are truncated."""
        taken = {record.name for _, record in self._read()}
        ends = itertools.chain([""], (f" ({number})" for number in itertools.count(2)))
        names = (name[: LONGEST_NAME - len(end)] + end for end in ends)
        return next(one for one in names if one not in taken)

    def row(self, experiment: str, run: str) -> RunRow:
        """Description of a run. Raises UnknownExperiment, UnknownRun and StorageFailed."""
        folder = self.run(experiment, run)
        if (written := run_version(folder)) is None:
            raise UnknownRun(f"The run {run[:100]!r} has no record.")
        try:
            return _row_of(folder, written)
        except BrokenRecording as error:
            raise StorageFailed(str(error)) from None

    def find_page(self, experiment: str) -> tuple[Path, ExperimentRecord]:
        """Folder and record of an experiment made by pages. Raises UnknownExperiment and ExperimentInUse."""
        folder, record = self.find(experiment)
        if record.source == "command":
            raise ExperimentInUse(f"The experiment {experiment} belongs to a command; start a new one on the page.")
        return folder, record

    def remove(self, experiment: str) -> None:
        """Remove an experiment. Raises UnknownExperiment and ExperimentInUse."""
        folder, _ = self.find(experiment)
        lock = folder / LOCK_NAME
        with storage_errors():
            try:
                with hold_lock(lock, "") if lock.exists() else nullcontext():
                    self._workspace.remove(folder)
            except StartError:
                raise ExperimentInUse(f"A command is running the experiment {experiment}; stop it first.") from None
            except FileNotFoundError:
                raise UnknownExperiment(f"The experiment {experiment} has been removed.") from None


def list_runs(folder: Path) -> list[Path]:
    """Folders of an experiment's runs, by name; empty if it has been removed."""
    runs = folder / "runs"
    if not _is_folder(runs):
        return []
    try:
        return sorted(path for path in runs.iterdir() if _is_folder(path))
    except FileNotFoundError:
        return []


def run_version(run: Path) -> tuple[int, ...] | None:
    """A value that changes whenever the run is rewritten, or more is known about its samples.

    None if the run has no record.
    """
    record = file_version(run / "run.json")
    if record is None:
        return None
    return sum((file_version(run / name) or (0,) for name in (SAMPLES, RERENDERED, SCORES)), record)


def file_version(path: Path) -> tuple[int, ...] | None:
    """A value that changes whenever the file is rewritten; None without a file."""
    try:
        told = path.lstat()
    except OSError:
        return None
    return told.st_mtime_ns, told.st_size, told.st_ino


def _read(reader: Callable[[Path, tuple[int, ...]], T], folder: Path) -> Iterator[T]:
    """A reader's results for all runs with readable records."""
    for run in list_runs(folder):
        if (written := run_version(run)) is not None:
            try:
                yield reader(run, written)
            except BrokenRecording:
                continue


@lru_cache(CACHED_RUNS)
def _record(run: Path, _written: tuple[int, ...]) -> RunRecord:
    return StoredRun(run).record


@lru_cache(CACHED_RUNS)
def _row_of(run: Path, _written: tuple[int, ...]) -> RunRow:
    summary = summarise(run)
    record = summary.record
    return RunRow(
        folder=summary.folder,
        status=record.status,
        problem=summary.problem,
        configuration=record.configuration,
        samples=count_samples(run),
        saturated_share=record.load.saturated_share if record.load is not None and record.load.saturated else None,
    )


def _is_folder(path: Path) -> bool:
    try:
        path.name.encode()
        return path.is_dir() and not path.is_symlink() and not path.name.startswith(".")
    except (OSError, ValueError):  # an invalid file name
        return False


def _move_to_place(made: Path, parent: Path, name: str) -> str:
    """Move a folder to its place, under the first unused name. Raises OSError."""
    for number in itertools.count(1):
        chosen = name if number == 1 else f"{name}_{number}"
        try:
            made.rename(parent / chosen)
        except OSError as error:
            if error.errno not in NAME_TAKEN_ERRORS:
                raise
        else:
            flush_folder(parent)
            return chosen
    raise AssertionError
