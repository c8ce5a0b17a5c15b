"""The command `tigas report`."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tigas_common.command import POSITIONAL, Command, Metavar
from tigas_common.errors import StartError
from tigas_common.terminal import make_console, printable, progress_bar

if TYPE_CHECKING:  # heavy
    from tigas_experiments.report.report import Report as Written

MAX_COLUMNS = 8
"""Maximum number of runs to print per network; more are easier to read as rows of a file."""
MOST_NETWORKS = 8
"""Maximum number of networks to print."""


class Report(Command):
    """Write the report of an experiment into its folder: report.html, tables and figures."""

    folder: Annotated[Path, POSITIONAL, Metavar("DIR")]
    """Folder of an experiment, with runs/; a folder of such folders; or an archive of either, to unpack first."""
    baseline: str | None = None
    """Controller with which to compare the others, such as latency, profile-2 or dash-tuned; by default the first."""
    archive: Path | None = None
    """Also pack the raw runs into this archive (.tar.xz), from which the report can be made again."""
    without_pictures: bool = False
    """Leave captures and samples out of the archive; tables and figures do not need them."""

    def run(self) -> None:
        from tigas_experiments.report.archive import (
            DIGESTS,
            Options,
            find_changed,
            find_experiments,
            pack,
            read_options,
            unpack,
        )
        from tigas_experiments.report.report import BEST_FILE, write_report
        from tigas_experiments.report.tables import best_markdown

        def on_progress(step: str, done: int, total: int | None) -> None:
            show(1.0 if total is None else done / total, step if total else f"{step}: {done}")

        made = {}
        with progress_bar() as show:
            folder = unpack(self.folder) if self.folder.is_file() else self.folder
            for each in find_experiments(folder):
                baseline = self.baseline or read_options(each).baseline
                made[each] = write_report(each, each, on_progress, baseline=baseline)
            if folder not in made:
                rows = [row for report in made.values() for row in report.best]
                (folder / BEST_FILE).write_text(best_markdown(rows), encoding="utf-8")
            if self.archive is not None:
                options = {each: Options(baseline=report.baseline) for each, report in made.items()}
                pack(folder, self.archive, options, pictures=not self.without_pictures)
        for report in made.values():
            _print(report)
        if self.archive is not None:
            with self.archive.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            print(printable(f"The archive: {self.archive}, SHA-256 {digest}"))
        if self.folder.is_file() and self.baseline is None and (folder / DIGESTS).is_file():
            if differ := find_changed(folder):
                raise StartError(
                    f"{len(differ)} tables and figures differ from the archived ones, such as {differ[0]}: another "
                    "version of TIGAS or its libraries made them."
                )
            print("All tables and figures are equal to the archived ones.")


def _print(made: Written) -> None:
    from tigas_experiments.report.run_listing import by_network, terminal_tables

    console = make_console()
    networks = list(by_network(made.results.made).items())
    for network, runs in networks[:MOST_NETWORKS]:
        if len(runs) > MAX_COLUMNS:
            console.print(f"{network}: {len(runs)} runs, a row each in table.md.")
            continue
        for table in terminal_tables(network, runs, console.width):
            console.print(table)
            console.print()
    if more := networks[MOST_NETWORKS:]:
        console.print(f"{len(more)} more in table.md.")
    for warning in made.warnings:
        console.print(warning, style="yellow")
    console.print(f"The report: {made.page}", soft_wrap=True)
