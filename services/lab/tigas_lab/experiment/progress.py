"""What `tigas experiment run` shows: a bar over all runs with the time left, and what the current one does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

from tigas_lab.configuration import Configuration
from tigas_lab.experiment.runner import Listener
from tigas_lab.store import RunRecord

SPEED_OVER_S = 3600
"""The time left is judged by the runs of the last hour: single runs take many seconds."""


@contextmanager
def progress(runs: Sequence[Configuration], missing: int, console: Console) -> Iterator[Listener]:
    """For as long as the context lasts. Where nobody watches, such as in a log, it prints a line a run."""
    columns = (
        SpinnerColumn(),
        MofNCompleteColumn(),
        BarColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
        TextColumn("left; {task.description}", markup=False),
    )
    with Progress(*columns, console=console, speed_estimate_period=SPEED_OVER_S) as bar:
        done = len(runs) - missing
        task = bar.add_task("", total=len(runs), completed=done)
        name = ""

        def begins(configuration: Configuration) -> None:
            nonlocal name
            name = configuration.slug

        def stage(what: str) -> None:
            bar.update(task, description=f"{name}: {what}" if name else what)

        def finished(record: RunRecord) -> None:
            nonlocal done
            done += 1
            if record.problem is not None:
                say(f"{name}: {record.problem}", "red")
            elif not console.is_terminal:
                say(f"{done}/{len(runs)} {name}")
            bar.advance(task)

        def say(text: str, style: str | None = None) -> None:
            console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)

        yield Listener(begins, stage, finished)
