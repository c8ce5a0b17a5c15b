"""What is shown while runs are made: a bar over all with the time left, and below it what the current one does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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

from tigas_common.wire.run import Configuration
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.run.runner import Listener

SPEED_OVER_S = 3600
"""The time left is judged by the runs of the last hour: single runs take many seconds."""
REFRESHES_PER_S = 2
"""Drawing takes processor time from what is measured."""


@contextmanager
def progress(runs: Sequence[Configuration], missing: int, console: Console) -> Iterator[Listener]:
    """For as long as the context lasts. Where nobody watches, such as in a log, it prints a line a run."""
    overall = Progress(
        MofNCompleteColumn(),
        BarColumn(),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        speed_estimate_period=SPEED_OVER_S,
    )
    current = Progress(SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    done = len(runs) - missing
    bar, line = overall.add_task("", total=len(runs), completed=done), current.add_task("", total=None)
    name = ""

    def begins(configuration: Configuration) -> None:
        nonlocal name
        name = configuration.slug
        current.reset(line)

    def stage(what: str) -> None:
        current.update(line, description=f"{name}: {what}" if name else what)

    def finished(record: RunRecord) -> None:
        nonlocal done
        done += 1
        if record.problem is not None:
            say(f"{name}: {record.problem}", "red")
        elif not console.is_terminal:
            say(f"{done}/{len(runs)} {name}")
        overall.advance(bar)

    def say(text: str, style: str | None = None) -> None:
        console.print(text, style=style, soft_wrap=True)

    shown = Group(overall, current) if console.is_terminal else ""
    with Live(shown, console=console, refresh_per_second=REFRESHES_PER_S, transient=True):
        yield Listener(begins, stage, finished)
