"""The command `tigas report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="An experiment's or a comparison's folder, with runs/.")
    ],
) -> None:
    """Write an experiment's report into its folder: report.html, its tables as CSV and Markdown, its figures as SVG."""
    from tigas_experiments.report.experiment import Listener, write_experiment_report

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with in_a_sentence(StartError, OSError), Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        runs, figures = bar.add_task("reads runs", total=None), bar.add_task("draws figures", total=None)
        made = write_experiment_report(
            folder,
            folder,
            Listener(
                lambda done, total: bar.update(runs, completed=done, total=total),
                lambda name: bar.update(figures, advance=1),
            ),
        )
    console = Console()
    for claim in made.claims:
        console.print(f"{claim.verdict}: {claim.text}. {claim.figures}", highlight=False, markup=False)
    for warning in made.warnings:
        console.print(warning, style="yellow", highlight=False, markup=False)
    console.print(f"The report: {made.page}", highlight=False, markup=False, soft_wrap=True)
