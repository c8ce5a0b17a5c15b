"""Progress of an experiment: estimated time, an overall bar, and the current run's step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

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

from tigas_experiments.records.folder import RunRecord
from tigas_experiments.run.experiment import Experiment
from tigas_experiments.run.plan import lasting
from tigas_experiments.run.runner import RunCallbacks
from tigas_experiments.wire.run import Configuration

SPEED_OVER_S = 3600
"""The time left is judged by the runs of the last hour: single runs take many seconds."""
REFRESHES_PER_S = 2
"""Low, because drawing takes processor time from the measurement."""


@contextmanager
def progress(
    experiment: Experiment, missing: Sequence[Configuration], names: Mapping[str, str], console: Console
) -> Iterator[RunCallbacks]:
    """Show progress during the context; prints a line per run outside a terminal.

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
        name = f"{done + 1}/{total} {names[configuration.slug]}"
        current.reset(line)

    def on_stage(what: str) -> None:
        current.update(line, description=f"{name}: {what}" if name else what)

    def on_finish(record: RunRecord) -> None:
        nonlocal done
        done += 1
        if record.problem is not None:
            say(f"{name}: {record.problem}", "red")
        elif not console.is_terminal:
            say(name)
        overall.advance(bar)

    def say(text: str, style: str | None = None) -> None:
        console.print(text, style=style, soft_wrap=True)

    count = f"{total} run{'s' if total != 1 else ''}"
    if missing:
        say(f"{f'{len(missing)} of ' if done else ''}{count}, about {lasting(missing)}, into {experiment.out}")
    shown = Group(overall, current) if console.is_terminal else ""
    with Live(shown, console=console, refresh_per_second=REFRESHES_PER_S, transient=True):
        yield RunCallbacks(on_begin, on_stage, on_finish)
