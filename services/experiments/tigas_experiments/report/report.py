"""Makes a report: loads the results, aggregates them, and writes tables, figures and a page that stands alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tigas_experiments.records.folder import Template
from tigas_experiments.report.comparison_page import comparison_page
from tigas_experiments.report.experiment_page import experiment_page
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.results import Results, Told, load
from tigas_experiments.report.tables import write_csv

PAGES = {"experiment": experiment_page, "comparison": comparison_page}


@dataclass(frozen=True, slots=True)
class Report:
    """What was written."""

    results: Results
    groups: Groups
    template: Template
    warnings: list[str]
    page: Path


def write_report(
    folder: Path, out: Path, template: Template | None = None, told: Told = lambda what, done, total: None
) -> Report:
    """Report on the runs of an experiment's folder, into another folder or its own.

    Writes report.html, runs.csv, groups.csv, and what its template has beside them. The experiment says which one that
    is, unless somebody chooses another.

    Raises StartError if it has no runs, and OSError if it cannot be written.
    """
    results = load(folder, told)
    groups = Groups.of(results.runs)
    csv_files = write_csv(results, groups, out)
    template = template or ("experiment" if results.experiment is None else results.experiment.template)
    page = PAGES[template](results, groups, out, told)
    path = out / "report.html"
    path.write_text(page.html(results, csv_files), encoding="utf-8")
    return Report(results, groups, template, page.warnings, path)
