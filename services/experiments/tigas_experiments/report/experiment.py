"""The report of an experiment: report.html, which stands alone, its figures as SVG, and tables as CSV and Markdown."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from tigas_experiments.report.claims import Claim, claims
from tigas_experiments.report.csv_files import write_csv
from tigas_experiments.report.drawing import for_a_page
from tigas_experiments.report.figures import Draughtsman, Drawing
from tigas_experiments.report.html import rendered, streams
from tigas_experiments.report.metrics import TABLE, Metric
from tigas_experiments.report.overall import markdown, overall, rtt_text
from tigas_experiments.report.results import Results, Spread, load

FIGURES_OF_NETWORKS = "[0-9][0-9]-*_*"
MOST_NETWORKS = 8
"""So many are drawn one by one; the table and the CSV files have all."""


@dataclass(frozen=True, slots=True)
class Listener:
    """Who wants to know how far it is."""

    read: Callable[[int, int], None]
    """So many runs of so many."""
    drawn: Callable[[str], None]
    """A figure."""


SILENT = Listener(lambda done, total: None, lambda name: None)


@dataclass(frozen=True, slots=True)
class Plot:
    """A figure in the page."""

    drawing: Drawing
    svg: Markup


@dataclass(frozen=True, slots=True)
class ExperimentReport:
    """What was written."""

    results: Results
    claims: list[Claim]
    warnings: list[str]
    page: Path


def write_experiment_report(folder: Path, out: Path, listener: Listener = SILENT) -> ExperimentReport:
    """Report on an experiment's runs, into another folder or its own.

    Writes report.html, runs.csv, groups.csv, overall.md and *.svg.

    Raises StartError if it has no runs, and OSError if it cannot be written.
    """
    results = load(folder, listener.read)
    files = write_csv(results, out)
    totals = overall(results)
    (out / "overall.md").write_text(markdown(totals), encoding="utf-8")
    for old in out.glob(f"{FIGURES_OF_NETWORKS}.svg"):  # of a report that had other networks
        old.unlink()
    overview: list[Plot] = []
    by_network: dict[str, list[Plot]] = {}
    for network, drawing in _drawings(results):
        listener.drawn(drawing.name)
        (out / f"{drawing.name}.svg").write_text(drawing.svg, encoding="utf-8")
        # matplotlib escapes text itself
        plots = overview if network is None else by_network.setdefault(network, [])
        plots.append(Plot(drawing, Markup(for_a_page(drawing.svg))))
    report = ExperimentReport(results, claims(results), warnings(results), out / "report.html")
    page = rendered(
        "experiment.html.j2",
        report=report,
        results=results,
        overview=overview,
        by_network=by_network,
        totals=totals if len(results.networks) > 1 else [],
        table=TABLE,
        cell=cell,
        rtt_text=rtt_text,
        files={path.name: base64.b64encode(path.read_bytes()).decode() for path in files},
        scenes=sorted({run.record.configuration.scene for run in results.runs}),
        movements=sorted({Path(run.record.configuration.movement).name for run in results.runs}),
        first=results.runs[0].record if results.runs else None,
        streams=streams(run.record for run in results.runs),
    )
    report.page.write_text(page, encoding="utf-8")
    return report


def cell(spread: Spread | None, metric: Metric) -> tuple[str, str | None]:
    """The mean; from the least to the greatest, where they differ."""
    if spread is None:
        return metric.text(None), None
    low, high = metric.text(spread.low), metric.text(spread.high)
    return metric.text(spread.mean), None if low == high else f"{low}–{high}"


def warnings(results: Results) -> list[str]:
    """What a reader must know before believing the figures."""
    found: list[str] = []
    runs = results.runs
    total = len(runs) + len(results.failures)
    if results.failures:
        found.append(
            f"{len(results.failures)} of {total} runs have no result and are in no figure; they are listed below."
        )
    if saturated := [run for run in runs if run.saturated]:
        found.append(
            f"The machine was the bottleneck in {len(saturated)} of {len(runs)} runs: all processors were busy for "
            "more than a tenth of the time, so that their latencies and frame rates tell of the machine, too. They are "
            "marked with *."
        )
    if unknown := sum(run.record.load is None for run in runs):
        found.append(f"The load of the machine is unknown in {unknown} of {len(runs)} runs.")
    if hidden := sum(run.record.recording is not None and run.record.recording.hidden for run in runs):
        found.append(
            f"The page was hidden during {hidden} of {len(runs)} runs, so the browser may have held frames back."
        )
    for name, values in _pooled(results).items():
        if len(values) > 1:
            found.append(f"Runs of different {name} ({', '.join(values)}) are taken together.")
    found += [f"The {kind} {name} was not the same in all runs." for kind, name in _changed(results)]
    if results.planned is not None and (missing := results.planned - total) > 0:
        found.append(f"{missing} of {results.planned} planned runs have not been made.")
    commits = {run.record.machine.commit for run in runs}
    if len(commits) > 1:
        found.append(f"The runs were made with {len(commits)} different versions of TIGAS.")
    return found


def _changed(results: Results) -> list[tuple[str, str]]:
    """Kind and name of the inputs whose content differs between runs."""
    contents: dict[tuple[str, str], set[str | int]] = {}
    for run in results.runs:
        record, configuration = run.record, run.record.configuration
        digests = record.inputs_sha256
        for kind, name, content in (
            ("scene", configuration.scene, record.scene_bytes),
            ("movement", Path(configuration.movement).name, None if digests is None else digests.movement),
            ("trace", configuration.network.name, None if digests is None else digests.trace),
        ):
            if content is not None:
                contents.setdefault((kind, name), set()).add(content)
    return [key for key, found in contents.items() if len(found) > 1]


def _pooled(results: Results) -> dict[str, list[str]]:
    """What no row, line or point tells apart, and the values that the runs have."""
    configurations = [run.record.configuration for run in results.runs]
    return {
        "durations": sorted({f"{each.duration_s:g} s" for each in configurations}),
        "viewports": sorted({f"{each.width}×{each.height}" for each in configurations}),
        "places in the trace": sorted(
            {f"{each.network.offset_s:g} s" for each in configurations if each.network.trace is not None}
        ),
    }


def _drawings(results: Results) -> Iterator[tuple[str | None, Drawing]]:
    """Each figure with the network that it is of."""
    draughtsman = Draughtsman(results)
    if (overview := draughtsman.overview()) is not None:
        yield None, overview
    for number, network in enumerate(results.networks[:MOST_NETWORKS], 1):
        slug = f"{number:02}-" + (re.sub(r"[^A-Za-z0-9.-]+", "-", network).strip(".-")[:40] or "network")
        for draw in (
            draughtsman.over_rtt,
            draughtsman.latencies,
            draughtsman.responses,
            draughtsman.over_time,
            draughtsman.profiles,
            draughtsman.bandwidth,
        ):
            if (drawing := draw(network)) is not None:
                yield network, Drawing(f"{slug}_{drawing.name}", drawing.title, drawing.caption, drawing.svg)
