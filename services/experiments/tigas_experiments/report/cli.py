"""The command `tigas report`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.terminal import make_console, printable

if TYPE_CHECKING:  # heavy
    from tigas_experiments.report.report import Report

MAX_COLUMNS = 8
"""So many runs fit into a terminal side by side."""


def report(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="An experiment's or a comparison's folder, with runs/; or an archive of one, unpacked first.",
        ),
    ],
    template: Annotated[
        Literal["experiment", "comparison"] | None,
        typer.Option(
            help="Claims over groups of runs, or run by run with pictures.",
            show_default="as packed; else as it was made",
        ),
    ] = None,
    baseline: Annotated[
        str | None,
        typer.Option(
            help="The controller that the others are compared with, such as latency, profile-2 or dash-tuned.",
            show_default="as packed; else the first in the experiment's file",
        ),
    ] = None,
    archive: Annotated[
        Path | None,
        typer.Option(help="Pack the raw runs into this .tar.xz, too, from which the report can be made again."),
    ] = None,
) -> None:
    """Write the report of an experiment or a comparison into its folder: report.html, tables and figures."""
    from tigas_experiments.report.archive import Options, pack, read_options, unpack
    from tigas_experiments.report.report import write_report

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with (
        in_a_sentence(StartError, OSError),
        Progress(*columns, console=make_console(stderr=True), transient=True) as bar,
    ):
        tasks: dict[str, TaskID] = {}

        def told(what: str, done: int, total: int | None) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what)
            bar.update(tasks[what], completed=done, total=total)

        if folder.is_file():
            folder = unpack(folder)
        packed = read_options(folder)
        made = write_report(folder, folder, template or packed.template, told, baseline=baseline or packed.baseline)
        if archive is not None:
            pack(folder, archive, Options(template=made.template, baseline=made.baseline))
    _print(made)
    if archive is not None:
        typer.echo(printable(f"The archive: {archive}"))


def _print(made: Report) -> None:
    """Print the report's main results, its warnings and its path."""
    from tigas_experiments.report.claims import claims
    from tigas_experiments.report.comparison_table import COLUMNS, by_network, cells, runs_as_made, titles
    from tigas_experiments.report.what_to_use import places, tally

    console = make_console()
    if made.template == "comparison":
        for network, runs in by_network(runs_as_made(made.results)).items():
            if len(runs) > MAX_COLUMNS:
                console.print(f"{network}: {len(runs)} runs, a row each in table.md.")
                continue
            table = Table(title=network, title_justify="left")
            table.add_column("", no_wrap=True)
            for title in titles(runs).values():
                table.add_column(title, justify="right")
            for column, *row in zip(COLUMNS, *map(cells, runs), strict=True):
                table.add_row(column.heading, *row)
            console.print(table)
    else:
        for question, counts in tally(places(made.groups)).items():
            console.print(f"{question}: {'; '.join(f'{name} {count}' for name, count in counts)}")
        for claim in claims(made.groups):
            if claim.verdict != "no data":  # the page has them all
                console.print(f"{claim.verdict}: {claim.text}. {claim.figures}")
    for warning in made.warnings:
        console.print(warning, style="yellow")
    console.print(f"The report: {made.page}", soft_wrap=True)
