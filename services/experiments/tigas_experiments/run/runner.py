"""Makes an experiment's missing runs, continues after failed runs, and shows the progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console, Group
from rich.live import Live
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column

from tigas_common.errors import StartError
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.run.checks import find_changes
from tigas_experiments.run.environment import Environment, open_environment
from tigas_experiments.run.experiment import GIVE_UP_AFTER, Experiment
from tigas_experiments.run.measure import measure_run
from tigas_experiments.run.plan import format_duration
from tigas_experiments.wire.run import Configuration

SPEED_OVER_S = 3600
"""Period of recent runs from which the remaining time is estimated, as single runs take many seconds."""
REFRESHES_PER_S = 2
"""Low, as drawing takes processor time from the measurement."""


@dataclass(frozen=True, slots=True)
class RunCallbacks:
    on_begin: Callable[[Configuration], None]
    on_stage: Callable[[str], None]
    """Called with the current step of the run."""
    on_finish: Callable[[RunRecord], None]


async def make_missing_runs(
    experiment: Experiment,
    missing: Sequence[Configuration],
    url: str | None,
    callbacks: RunCallbacks,
    *,
    allow_changes: bool = False,
) -> None:
    """Make an experiment's missing runs with the services at a URL or in the lab.

    Raises OSError, and StartError if nothing can be started, if versions or inputs have changed since the existing
    runs, or after GIVE_UP_AFTER consecutive failures.
    """
    ladder, webgpu = experiment.plan.ladder, any(run.enhanced for run in experiment.runs)
    opened = open_environment(url, experiment.inputs, ladder=ladder, webgpu=webgpu)
    async with opened as environment:
        callbacks.on_stage("starting the services")
        await prepare(experiment, missing, environment, allow_changes=allow_changes)
        await make_runs(experiment, missing, environment, callbacks)


async def prepare(
    experiment: Experiment, missing: Sequence[Configuration], environment: Environment, *, allow_changes: bool
) -> None:
    """Check that the missing runs can be made, and write the experiment's plan. Raises OSError and StartError."""
    await environment.check(missing)
    if not allow_changes:
        await _check_changes(experiment, missing, environment)
    experiment.write()


async def _check_changes(experiment: Experiment, missing: Sequence[Configuration], environment: Environment) -> None:
    """Raise StartError if the commit, browser, ladder or scenes differ from those of the existing runs."""
    kept = experiment.kept_records(missing)
    if not kept:
        return
    changed = find_changes(kept, await environment.versions(sorted({record.configuration.scene for record in kept})))
    if changed:
        raise StartError(
            f"Since the complete runs in {experiment.out} were made, there is another {' and another '.join(changed)}: "
            "choose another --out, or --allow-changes to combine them."
        )


async def make_runs(
    experiment: Experiment, missing: Sequence[Configuration], environment: Environment, callbacks: RunCallbacks
) -> None:
    """Make runs one after the other. Raises StartError after GIVE_UP_AFTER consecutive failures."""
    failures = 0
    for configuration in missing:
        callbacks.on_begin(configuration)
        experiment.set_aside(configuration)
        record = await measure_run(environment, configuration, experiment.folder(configuration), callbacks.on_stage)
        callbacks.on_finish(record)
        failures = 0 if record.status == "complete" else failures + 1
        if failures == GIVE_UP_AFTER:
            raise StartError(
                f"{failures} runs in a row failed, so the others are not tried; run the same command to continue. "
                f"The last failure: {record.problem}"
            )


@contextmanager
def progress(
    experiment: Experiment, missing: Sequence[Configuration], names: Mapping[str, str], console: Console
) -> Iterator[RunCallbacks]:
    """Show progress during the context. Outside a terminal, prints one line per run.

    `names` are the runs' display names by folder.
    """
    overall = Progress(
        MofNCompleteColumn(),
        BarColumn(),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        speed_estimate_period=SPEED_OVER_S,
    )
    wrapped = Column(overflow="fold")
    current = Progress(
        SpinnerColumn(), TextColumn("{task.description}", markup=False, table_column=wrapped), TimeElapsedColumn()
    )
    total = len(experiment.runs)
    done = total - len(missing)
    bar, line = overall.add_task("", total=total, completed=done), current.add_task("", total=None)
    name = ""

    def on_begin(configuration: Configuration) -> None:
        nonlocal name
        name = numbered(configuration)
        current.reset(line)

    def on_stage(stage: str) -> None:
        current.update(line, description=f"{name}: {stage}" if name else stage)

    def on_finish(record: RunRecord) -> None:
        nonlocal done
        finished = numbered(record.configuration)
        done += 1
        if record.problem is not None:
            say(f"{finished}: {record.problem}", "red")
        elif not console.is_terminal:
            say(finished)
        overall.advance(bar)

    def numbered(configuration: Configuration) -> str:
        return f"{done + 1}/{total} {names[configuration.slug]}"

    def say(text: str, style: str | None = None) -> None:
        console.print(text, style=style, soft_wrap=True)

    count = f"{total} run{'s' if total != 1 else ''}"
    if missing:
        say(f"{f'{len(missing)} of ' if done else ''}{count}, about {format_duration(missing)}, into {experiment.out}")
    shown = Group(overall, current) if console.is_terminal else ""
    with Live(shown, console=console, refresh_per_second=REFRESHES_PER_S, transient=True):
        yield RunCallbacks(on_begin, on_stage, on_finish)
