"""Writes a report: loads the results, groups them, and writes tables, figures and the page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tigas_experiments.report.differences import against, choose_baseline
from tigas_experiments.report.figures import OVERVIEW_NAMES, drawn_networks, figures, write_headline
from tigas_experiments.report.groups import Groups, overall
from tigas_experiments.report.page import Page
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.results import OnProgress, Results, load, sampled_runs
from tigas_experiments.report.run_listing import markdown, runs_as_made
from tigas_experiments.report.tables import overall_markdown, write_csv
from tigas_experiments.report.warnings import warnings


@dataclass(frozen=True, slots=True)
class Report:
    """A report that was written."""

    results: Results
    groups: Groups
    baseline: str | None
    """Name of the controller that the others were compared with; None without runs."""
    warnings: list[str]
    page: Path


def write_report(
    folder: Path,
    out: Path,
    on_progress: OnProgress = lambda step, done, total: None,
    *,
    baseline: str | None = None,
) -> Report:
    """Write the report on an experiment's folder into `out`: report.html, CSV and Markdown tables, and SVG figures.

    `baseline` overrides the controller that the others are compared with. Raises StartError without runs, or without
    runs of the baseline, and OSError.
    """
    results = load(folder, on_progress)
    groups = Groups.of(results.runs)
    base = choose_baseline(groups, results.experiment, baseline)
    compared = against(groups, base) if base is not None else []
    sampled = sampled_runs(results)
    csv_files = write_csv(results, groups, compared, base, out)
    made, totals = runs_as_made(results), overall(groups)
    (out / "table.md").write_text(markdown(made), encoding="utf-8")
    (out / "overall.md").write_text(overall_markdown(totals), encoding="utf-8")
    page = Page(
        results=results,
        groups=groups,
        made=made,
        totals=totals if len(groups.networks) > 1 else [],
        baseline=base,
        compared=compared,
        sampled=sampled,
        warnings=warnings(results, sampled),
        plots=_write_figures(groups, out, on_progress),
        csv_files=csv_files,
    )
    path = out / "report.html"
    path.write_text(page.html(), encoding="utf-8")
    return Report(results, groups, None if base is None else base.name, page.warnings, path)


def _write_figures(groups: Groups, out: Path, on_progress: OnProgress) -> dict[str | None, list[Plot]]:
    """Write all figures by network, and remove figures of earlier reports."""
    for old in out.glob("[0-9][0-9]-*_*.svg"):
        old.unlink()
    for name in (*(f"{name}.svg" for name in OVERVIEW_NAMES), "headline.svg", "headline.png"):
        (out / name).unlink(missing_ok=True)
    plots: dict[str | None, list[Plot]] = {network: [] for network in (None, *drawn_networks(groups))}
    for count, (network, plot) in enumerate(figures(groups), 1):
        (out / f"{plot.name}.svg").write_text(plot.svg, encoding="utf-8")
        plots[network].append(plot)
        on_progress("draws figures", count, None)
    if groups:
        write_headline(groups, out)
    return plots
