"""An experiment: its runs, their folders, and which of them are missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

from tigas_common.errors import StartError
from tigas_experiments.lock import LOCK_NAME, hold_lock
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import (
    ExperimentRecord,
    InputDigests,
    RunRecord,
    StoredRun,
    read_experiment,
    write_experiment,
)
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.plan import ExperimentPlan
from tigas_experiments.wire.run import Configuration

GIVE_UP_AFTER = 5
"""Number of consecutive failures that ends an experiment."""
RUNS, EARLIER = "runs", "earlier"


@dataclass(frozen=True, slots=True)
class Experiment:
    plan: ExperimentPlan
    runs: Sequence[Configuration]
    inputs: Inputs
    out: Path
    command: str | None
    """The command line; None for an experiment made on the page."""

    @classmethod
    def from_plan(
        cls,
        plan: ExperimentPlan,
        directory: Path,
        out: Path,
        command: str | None = None,
        traces_s: Mapping[str, float] = {},
    ) -> Experiment:
        """Create an experiment from a plan with paths relative to `directory`. Raises StartError."""
        return cls(plan, plan.runs(directory, traces_s), Inputs(directory), out, command)

    @classmethod
    def read(cls, file: Path, out: Path | None, command: str) -> Experiment:
        """Read an experiment file; the output folder is results/NAME by default. Raises StartError."""
        plan = ExperimentPlan.read(file)
        return cls.from_plan(plan, file.parent, out or Path("results", plan.name), command)

    @property
    def has_begun(self) -> bool:
        runs = self.out / RUNS
        return runs.is_dir() and any(runs.iterdir())

    def folder(self, configuration: Configuration) -> Path:
        return self.out / RUNS / configuration.slug

    def missing(self) -> list[Configuration]:
        """The runs without a complete folder that has their configuration and inputs. Raises StartError."""
        return [run for run in self.runs if not _is_complete(self.folder(run), run, self.inputs.digests(run))]

    def unrelated(self) -> list[str]:
        known = {run.slug for run in self.runs}
        runs = self.out / RUNS
        return sorted(path.name for path in runs.iterdir() if path.name not in known) if runs.is_dir() else []

    def kept_records(self, missing: Sequence[Configuration]) -> list[RunRecord]:
        """Records of the runs that are not missing."""
        todo = {run.slug for run in missing}
        return [StoredRun(self.folder(run)).record for run in self.runs if run.slug not in todo]

    def set_aside(self, configuration: Configuration) -> None:
        """Move an earlier attempt at a run to a folder that reports ignore."""
        folder, earlier = self.folder(configuration), self.out / EARLIER
        if folder.exists():
            earlier.mkdir(exist_ok=True)
            folder.rename(next(path for n in count(1) if not (path := earlier / f"{folder.name}.{n}").exists()))

    def write(self, traces_s: Mapping[str, float] = {}, name: str | None = None) -> None:
        """Write experiment.json, with `name` in place of the plan's name; a resumed experiment keeps its start time."""
        try:
            created = read_experiment(self.out).created
        except BrokenRecording:
            created = datetime.now(UTC).isoformat(timespec="seconds")
        record = ExperimentRecord(
            name=name or self.plan.name,
            created=created,
            source="command" if self.command else "page",
            plan=self.plan.model_dump(mode="json", exclude_none=True),
            planned=len(self.runs),
            command=self.command,
            traces_s=dict(traces_s),
        )
        write_experiment(self.out, record)


@contextmanager
def reserve_folder(experiment: Experiment) -> Iterator[None]:
    """Lock the folder during the context, and remove it if nothing was started.

    Raises StartError and OSError.
    """
    is_new = not experiment.out.exists()
    experiment.out.mkdir(parents=True, exist_ok=True)
    busy = f"Another experiment is writing into {experiment.out}; wait until it ends, or choose another --out."
    with hold_lock(experiment.out / LOCK_NAME, busy):
        if unrelated := experiment.unrelated():
            raise StartError(
                f"{experiment.out} has {len(unrelated)} runs of another experiment, such as {unrelated[0]}; "
                "choose another --out, or remove them."
            )
        try:
            yield
        finally:
            lock = experiment.out / LOCK_NAME
            if is_new and list(experiment.out.iterdir()) == [lock]:  # the lock is still held
                lock.unlink()
                experiment.out.rmdir()


def _is_complete(folder: Path, configuration: Configuration, inputs: InputDigests) -> bool:
    try:
        record = StoredRun(folder).record
    except BrokenRecording:
        return False
    same_inputs = record.inputs_sha256 in (None, inputs)  # early records have no digests
    return record.status == "complete" and same_inputs and record.configuration.asks_for_the_same(configuration)
