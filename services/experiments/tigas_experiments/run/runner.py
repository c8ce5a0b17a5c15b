"""Makes an experiment's missing runs, and continues after a failed run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

from tigas_common.errors import StartError
from tigas_experiments.lock import EXPERIMENT, exclusive
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import (
    ExperimentRecord,
    InputDigests,
    RunRecord,
    StoredRun,
    read_experiment,
    write_experiment,
)
from tigas_experiments.run.environment import Environment, changes, open_environment
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.measure import run
from tigas_experiments.run.plan import ExperimentPlan
from tigas_experiments.wire.run import Configuration

GIVE_UP_AFTER = 5
"""Consecutive failures that end an experiment."""
RUNS, EARLIER = "runs", "earlier"


@dataclass(frozen=True, slots=True)
class RunCallbacks:
    """Callbacks of an experiment's progress."""

    on_begin: Callable[[Configuration], None]
    on_stage: Callable[[str], None]
    """Receives the current step of the run."""
    on_finish: Callable[[RunRecord], None]


@dataclass(frozen=True, slots=True)
class Experiment:
    """Runs with their inputs and output folder."""

    plan: ExperimentPlan
    runs: Sequence[Configuration]
    inputs: Inputs
    out: Path
    command: str
    """The command line."""

    @classmethod
    def of(cls, plan: ExperimentPlan, directory: Path, out: Path, command: str) -> Experiment:
        """An experiment from a plan with paths relative to a directory. Raises StartError."""
        return cls(plan, plan.runs(directory), Inputs(directory), out, command)

    @classmethod
    def read(cls, file: Path, out: Path | None, command: str) -> Experiment:
        """An experiment's file; its folder is results/NAME if it is not said. Raises StartError."""
        plan = ExperimentPlan.read(file)
        return cls.of(plan, file.parent, out or Path("results", plan.name), command)

    @property
    def begun(self) -> bool:
        """Whether any run was started."""
        runs = self.out / RUNS
        return runs.is_dir() and any(runs.iterdir())

    def folder(self, configuration: Configuration) -> Path:
        """Folder of a run."""
        return self.out / RUNS / configuration.slug

    def missing(self) -> list[Configuration]:
        """The runs that have no complete folder with their configuration and inputs. Raises StartError."""
        return [run for run in self.runs if not _is_complete(self.folder(run), run, self.inputs.digests(run))]

    def unrelated(self) -> list[str]:
        """Folders of runs that are not of this experiment."""
        known = {run.slug for run in self.runs}
        runs = self.out / RUNS
        return sorted(path.name for path in runs.iterdir() if path.name not in known) if runs.is_dir() else []


async def make_missing_runs(
    experiment: Experiment,
    missing: Sequence[Configuration],
    url: str | None,
    callbacks: RunCallbacks,
    *,
    allow_changes: bool = False,
) -> None:
    """Make an experiment's missing runs with the services at a URL or in the lab.

    Raises OSError, and StartError if nothing can start, if versions or inputs have changed since the kept runs, or
    after GIVE_UP_AFTER consecutive failures.
    """
    ladder, webgpu = experiment.plan.ladder, any(run.enhanced for run in missing)
    opened = open_environment(url, experiment.inputs, ladder=ladder, webgpu=webgpu)
    async with opened as environment:
        callbacks.on_stage("starts the services")
        await environment.check(missing)
        if not allow_changes:
            await _check_changes(experiment, missing, environment)
        _say_what_is_planned(experiment)
        await _make(experiment, missing, environment, callbacks)


@contextmanager
def reserved(experiment: Experiment) -> Iterator[None]:
    """Lock the folder during the context, and remove it if nothing was started.

    Raises StartError and OSError.
    """
    is_new = not experiment.out.exists()
    experiment.out.mkdir(parents=True, exist_ok=True)
    busy = f"Another experiment is writing into {experiment.out}; wait until it has ended, or choose another --out."
    with exclusive(experiment.out / EXPERIMENT, busy):
        if unrelated := experiment.unrelated():
            raise StartError(
                f"{experiment.out} has {len(unrelated)} runs that are not of this experiment, such as {unrelated[0]}; "
                "choose another --out, or remove them."
            )
        try:
            yield
        finally:
            lock = experiment.out / EXPERIMENT
            if is_new and list(experiment.out.iterdir()) == [lock]:  # which is still locked
                lock.unlink()
                experiment.out.rmdir()


async def _check_changes(experiment: Experiment, missing: Sequence[Configuration], environment: Environment) -> None:
    """Raise StartError if commit, browser, ladder or scenes differ from the kept runs'."""
    todo = {run.slug for run in missing}
    kept = [StoredRun(experiment.folder(run)).record for run in experiment.runs if run.slug not in todo]
    if not kept:
        return
    changed = changes(kept, await environment.made_with(sorted({record.configuration.scene for record in kept})))
    if changed:
        raise StartError(
            f"Since the complete runs in {experiment.out} were made, there is another {' and another '.join(changed)}: "
            "choose another --out, or --allow-changes to take them together."
        )


async def _make(
    experiment: Experiment, missing: Sequence[Configuration], environment: Environment, callbacks: RunCallbacks
) -> None:
    failures = 0
    for configuration in missing:
        callbacks.on_begin(configuration)
        folder = experiment.folder(configuration)
        _set_aside(folder, experiment.out / EARLIER)
        record = await run(environment, configuration, folder, callbacks.on_stage)
        callbacks.on_finish(record)
        failures = 0 if record.status == "complete" else failures + 1
        if failures == GIVE_UP_AFTER:
            raise StartError(
                f"{failures} runs in a row failed, so the others are not tried; the same command goes on. The last one "
                f"failed for this: {record.problem}"
            )


def _is_complete(folder: Path, configuration: Configuration, inputs: InputDigests) -> bool:
    try:
        record = StoredRun(folder).record
    except BrokenRecording:
        return False
    same_inputs = record.inputs_sha256 in (None, inputs)  # early records say nothing of theirs
    return record.status == "complete" and same_inputs and record.configuration.asks_for_the_same(configuration)


def _set_aside(folder: Path, earlier: Path) -> None:
    """Move an earlier attempt to a folder that reports ignore."""
    if folder.exists():
        earlier.mkdir(exist_ok=True)
        folder.rename(next(path for number in count(1) if not (path := earlier / f"{folder.name}.{number}").exists()))


def _say_what_is_planned(experiment: Experiment) -> None:
    """experiment.json; resumed, it keeps the time at which it was begun."""
    try:
        created = read_experiment(experiment.out).created
    except BrokenRecording:
        created = datetime.now(UTC).isoformat(timespec="seconds")
    record = ExperimentRecord(
        name=experiment.plan.name,
        created=created,
        source="command",
        plan=experiment.plan.model_dump(mode="json", exclude_none=True),
        planned=len(experiment.runs),
        command=experiment.command,
    )
    write_experiment(experiment.out, record)
