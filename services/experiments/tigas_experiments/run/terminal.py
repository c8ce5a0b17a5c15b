"""What `tigas compare` shows in a terminal while it works, and in the end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from tigas_common.wire.run import Configuration
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.report.page import ReportData, warnings
from tigas_experiments.report.table import COLUMNS, by_network, cells, label
from tigas_experiments.run.compare import Listener


@contextmanager
def progress(runs: Sequence[Configuration]) -> Iterator[Listener]:
    """A bar over the runs, and what is going on."""
    columns = (
        SpinnerColumn(),
        MofNCompleteColumn(),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=len(runs))
        done = 0

        def name() -> str:
            return f"{runs[done].network.label}, {runs[done].mode}" if done < len(runs) else ""

        def stage(what: str) -> None:
            bar.update(task, description=f"{name()}: {what}")

        def finished(record: RunRecord) -> None:
            nonlocal done
            if record.problem is not None:
                bar.console.print(f"{name()}: {record.problem}", style="red", highlight=False, markup=False)
            done += 1
            bar.advance(task)

        yield Listener(stage, finished)


def print_report(report: ReportData, out: Path) -> None:
    """The table, what to know of it, and where the rest is."""
    console = Console()
    for network, runs in by_network(report.runs).items():
        table = Table(title=network, title_justify="left")
        table.add_column("", no_wrap=True)
        for run in runs:
            table.add_column(label(run), justify="right")
        rows = [cells(run) for run in runs]
        for index, column in enumerate(COLUMNS):
            table.add_row(column.heading, *(row[index] for row in rows))
        console.print(table)
    for warning in warnings(report):
        console.print(warning, style="yellow", highlight=False, markup=False)
    console.print(f"The report: {out / 'report.html'}", highlight=False, markup=False, soft_wrap=True)
