"""Writing of reports: loads the results, groups them, and writes tables, figures and the page."""

from __future__ import annotations

import base64
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tigas_common.files import read_regular
from tigas_experiments.records.folder import LADDER
from tigas_experiments.records.samples import MAX_PICTURE_BYTES
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.estimates import MIN_PEOPLE, MIN_WINDOWS, signed_text, significant
from tigas_experiments.report.figures import FIGURE_FILES, MOST_NETWORKS, figures
from tigas_experiments.report.gallery import Snapshot, gallery, snapshots
from tigas_experiments.report.groups import Groups, choose_baseline
from tigas_experiments.report.metrics import TABLE
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.rate_distortion import QUALITIES, by_condition, over_all
from tigas_experiments.report.run_listing import COLUMN_GROUPS, by_network, markdown, titles
from tigas_experiments.report.run_table import OnProgress, Results, Run, load_results
from tigas_experiments.report.tables import BEST, best_markdown, best_rows, overall_markdown, write_csv
from tigas_experiments.report.time_figures import write_headline
from tigas_experiments.report.warnings import collect_warnings
from tigas_experiments.wire.figures import INTERACTIVE_MS

BEST_FILE = "best.md"
MOST_RUNS = 16
"""Maximum number of runs of a network that are listed individually."""
Plots = dict[str | None, list[Plot]]
"""Figures by network; None: over all networks."""


class Report(NamedTuple):
    results: Results
    baseline: str | None
    """Name of the controller with which the others were compared; None without runs."""
    warnings: list[str]
    page: Path
    best: list[list[str]]
    """Rows of BEST."""


class Listing(NamedTuple):
    """The individual runs over one network at one round trip."""

    label: str
    runs: list[tuple[str, Run]]
    """Titles and runs."""
    snapshots: list[Snapshot]


def write_report(
    folder: Path,
    out: Path,
    on_progress: OnProgress = lambda step, done, total: None,
    *,
    baseline: str | None = None,
) -> Report:
    """Write the report on an experiment's folder into `out`: report.html, CSV and Markdown tables, and SVG figures.

    `baseline` overrides the controller with which the others are compared. Raises StartError if there are no runs, or
    no runs of the baseline, and OSError.
    """
    results = load_results(folder, on_progress)
    clear(out)
    groups = Groups.from_runs(results.runs)
    base = choose_baseline(groups, results.experiment, baseline)
    differences = groups.against(base) if base is not None else []
    distortions = [found for found in (over_all(groups), *by_condition(groups)) if found is not None]
    csv_files = write_csv(results, groups, differences, distortions, out)
    totals, complete = groups.overall(), [run for run in results.made if run.problem is None]
    (out / "table.md").write_text(markdown(results.made), encoding="utf-8")
    (out / "overall.md").write_text(overall_markdown(totals), encoding="utf-8")
    rows = best_rows(groups, results.title)
    if rows:
        (out / BEST_FILE).write_text(best_markdown(rows), encoding="utf-8")
    report = Report(results, None if base is None else base.name, collect_warnings(results), out / "report.html", rows)
    plots = _write_figures(groups, out, on_progress)
    streams = {run: run.record.recording.dash for run in complete if run.record.recording}
    environment = Environment(
        loader=PackageLoader("tigas_experiments.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("report.html.j2").render(
        results=results,
        groups=groups,
        complete=complete,
        warnings=report.warnings,
        plots=plots,
        listings=_listings(results, plots),
        best=rows,
        best_headings=BEST,
        totals=totals if len(groups.networks) > 1 else [],
        differences=differences,
        equal_rates=[each for each in distortions if each.equal_rates],
        samples=gallery(results.runs),
        ladder=_ladder(folder),
        csv={path.name: _download(path) for path in csv_files},
        streams={
            Controller.from_configuration(run.configuration).title_with_mode: dash
            for run, dash in streams.items()
            if dash
        },
        columns=TABLE,
        column_groups=COLUMN_GROUPS,
        qualities=QUALITIES,
        interactive_ms=f"{INTERACTIVE_MS:g}",
        least_windows=MIN_WINDOWS,
        least_people=MIN_PEOPLE,
        certain=significant,
        signed=signed_text,
    )
    report.page.write_text(page, encoding="utf-8")
    return report


def clear(folder: Path) -> None:
    """Remove files of an earlier report that the next one might not replace."""
    for old in chain.from_iterable(folder.glob(pattern) for pattern in (*FIGURE_FILES, "headline.png", BEST_FILE)):
        old.unlink(missing_ok=True)


def _write_figures(groups: Groups, out: Path, on_progress: OnProgress) -> Plots:
    """Write all figures, and return them by network."""
    plots: Plots = {network: [] for network in (None, *groups.networks[:MOST_NETWORKS])}
    for count, (network, plot) in enumerate(figures(groups), 1):
        (out / f"{plot.name}.svg").write_text(plot.svg, encoding="utf-8")
        plots[network].append(plot)
        on_progress("draws figures", count, None)
    if groups:
        write_headline(groups, out)
    return plots


def _listings(results: Results, plots: Plots) -> dict[str, list[Listing]]:
    """Listings by network, for networks with their own figures and at most MOST_RUNS runs per round trip."""
    found: dict[str, list[Listing]] = {}
    for label, runs in by_network(results.made).items():
        network = runs[0].configuration.network.name
        if network in plots and len(runs) <= MOST_RUNS:
            named = list(zip(titles(runs), runs, strict=True))
            found.setdefault(network, []).append(Listing(label, named, snapshots(named)))
    return found


def _download(path: Path) -> Markup:
    """A link that contains the file."""
    data = base64.b64encode(path.read_bytes()).decode()
    return Markup('<a download="{0}" href="data:text/csv;base64,{1}">{0}</a>').format(path.name, data)


def _ladder(folder: Path) -> str | None:
    """The ladder's picture as a data: URL; None without one."""
    with suppress(OSError):
        data = read_regular(folder / LADDER, MAX_PICTURE_BYTES)
        return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"
    return None
