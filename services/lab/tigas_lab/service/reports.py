"""Reports of experiments, made when somebody asks and kept until a run comes or goes."""

from __future__ import annotations

import threading
from pathlib import Path

from tigas_lab.report.page import write_report
from tigas_lab.service.errors import NothingToReport, storage_explained
from tigas_lab.service.experiments import Experiments, run_folders, version
from tigas_lab.service.workspace import Workspace

REPORT = "report.html"
Versions = tuple[tuple[str, tuple[int, ...] | None], ...]


class Reports:
    """One at a time: drawing takes a processor for itself, and its settings are the process' own."""

    def __init__(self, experiments: Experiments, workspace: Workspace) -> None:
        self._experiments = experiments
        self._workspace = workspace
        self._lock = threading.Lock()
        self._made: dict[str, Versions] = {}
        """Of which runs the report in an experiment's folder is."""

    def html(self, experiment: str) -> bytes:
        """The report, which is in the experiment's folder, too, with all its files. It may take seconds.

        Raises UnknownExperiment, NothingToReport and DiskFull.
        """
        with self._lock:
            folder, record = self._experiments.find(experiment)
            runs = run_folders(folder)
            versions = tuple((run.name, version(run)) for run in runs)
            if not runs:
                raise NothingToReport("The experiment has no runs yet.")
            with storage_explained():
                if self._made.get(experiment) != versions or not (folder / REPORT).is_file():
                    self._make(folder, runs, record.name)
                    self._made[experiment] = versions
                return (folder / REPORT).read_bytes()

    def _make(self, folder: Path, runs: list[Path], title: str) -> None:
        with self._workspace.folder() as made:
            write_report(runs, made, title, f"tigas report {folder.name}")
            for path in made.iterdir():
                path.replace(folder / path.name)
