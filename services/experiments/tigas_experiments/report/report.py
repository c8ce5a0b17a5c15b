"""Writes a report: loads the results, groups them, and writes tables, figures and the page."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from tigas_experiments.report.figures import MOST_NETWORKS, OVERVIEW_FIGURES, figures
from tigas_experiments.report.groups import Groups, choose_baseline
from tigas_experiments.report.page import page
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.rate_distortion import by_condition, over_all
from tigas_experiments.report.run_listing import markdown
from tigas_experiments.report.run_table import OnProgress, Results, load
from tigas_experiments.report.tables import overall_markdown, write_csv
from tigas_experiments.report.time_figures import write_headline
from tigas_experiments.report.warnings import warnings


class Report(NamedTuple):
    """A report that was written."""

    results: Results
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
    differences = groups.against(base) if base is not None else []
    distortions = [found for found in (over_all(groups), *by_condition(groups)) if found is not None]
    csv_files = write_csv(results, groups, differences, distortions, out)
    (out / "table.md").write_text(markdown(results.made), encoding="utf-8")
    (out / "overall.md").write_text(overall_markdown(groups.overall()), encoding="utf-8")
    told = warnings(results)
    plots = _write_figures(groups, out, on_progress)
    path = out / "report.html"
    path.write_text(page(results, groups, differences, distortions, told, plots, csv_files), encoding="utf-8")
    return Report(results, None if base is None else base.name, told, path)


def _write_figures(groups: Groups, out: Path, on_progress: OnProgress) -> dict[str | None, list[Plot]]:
    """Write all figures by network, and remove figures of earlier reports."""
    earlier = [*(f"{name}.svg" for name in OVERVIEW_FIGURES), "headline.svg", "headline.png"]
    for old in (*out.glob("[0-9][0-9]-*_*.svg"), *(out / name for name in earlier)):
        old.unlink(missing_ok=True)
    plots: dict[str | None, list[Plot]] = {network: [] for network in (None, *groups.networks[:MOST_NETWORKS])}
    for count, (network, plot) in enumerate(figures(groups), 1):
        (out / f"{plot.name}.svg").write_text(plot.svg, encoding="utf-8")
        plots[network].append(plot)
        on_progress("draws figures", count, None)
    if groups:
        write_headline(groups, out)
    return plots
