"""The page of a report: its template, filled with tables, figures and pictures."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tigas_common.files import read_regular
from tigas_experiments.records.load import Load
from tigas_experiments.records.samples import MAX_PICTURE_BYTES
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.estimates import LEAST_BLOCKS, Estimate, signed
from tigas_experiments.report.gallery import Snapshot, gallery, snapshots
from tigas_experiments.report.groups import Difference, Groups
from tigas_experiments.report.metrics import NONE, TABLE, Metric
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.rate_distortion import QUALITIES, RateDistortion
from tigas_experiments.report.run_listing import COLUMN_GROUPS, by_network, titles
from tigas_experiments.report.run_table import LADDER, Results, Run
from tigas_experiments.wire.figures import INTERACTIVE_MS

MOST_RUNS = 16
"""Maximum number of runs of a network that are listed one by one."""


Cell = tuple[str, str, bool]
"""A figure, its range or interval, and whether it is bold."""


class Listing(NamedTuple):
    """The runs over one network at one round trip, one by one."""

    label: str
    runs: list[tuple[str, Run]]
    """Titles and runs."""
    snapshots: list[Snapshot]


def page(
    results: Results,
    groups: Groups,
    differences: Sequence[Difference],
    distortions: Sequence[RateDistortion],
    warnings: Sequence[str],
    plots: Mapping[str | None, Sequence[Plot]],
    csv_files: Iterable[Path],
) -> str:
    """The rendered template, which escapes values unless they are markup; `plots` by network (None: all networks)."""
    environment = Environment(
        loader=PackageLoader("tigas_experiments.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    complete = [run for run in results.made if run.problem is None]
    return environment.get_template("report.html.j2").render(
        results=results,
        groups=groups,
        complete=complete,
        warnings=warnings,
        plots=plots,
        listings=_listings(results, plots),
        totals=groups.overall() if len(groups.networks) > 1 else [],
        differences=differences,
        equal_rates=[each for each in distortions if each.equal_rates],
        samples=gallery(results.runs),
        ladder=_ladder(results.folder),
        csv={path.name: _download(path) for path in csv_files},
        streams=_streams(complete),
        columns=TABLE,
        column_groups=COLUMN_GROUPS,
        qualities=QUALITIES,
        interactive_ms=f"{INTERACTIVE_MS:g}",
        least_blocks=LEAST_BLOCKS,
        mean_cell=mean_cell,
        difference_cell=difference_cell,
        pegged_text=pegged_text,
    )


def mean_cell(estimate: Estimate | None, metric: Metric) -> Cell:
    """Mean and range."""
    return (NONE, "", False) if estimate is None else (metric.text(estimate.mean), estimate.range_text(metric), False)


def difference_cell(estimate: Estimate | None, metric: Metric) -> Cell:
    """Difference and interval, in bold if the interval excludes zero."""
    if estimate is None:
        return NONE, "", False
    return signed(metric, estimate.mean), estimate.interval_text(metric), estimate.certain


def _listings(results: Results, plots: Mapping[str | None, object]) -> dict[str, list[Listing]]:
    """Listings by network, for networks with figures of their own and at most MOST_RUNS runs per round trip."""
    found: dict[str, list[Listing]] = {}
    for label, runs in by_network(results.made).items():
        network = runs[0].configuration.network.name
        if network in plots and len(runs) <= MOST_RUNS:
            named = titles(runs)
            listing = Listing(label, list(zip(named, runs, strict=True)), snapshots(runs, named))
            found.setdefault(network, []).append(listing)
    return found


def pegged_text(load: Load | None) -> str:
    """The busiest saturated thread as a table cell."""
    if load is None or load.pegged is None:
        return "unknown"
    if load.worst_pegged is None:
        return "never"
    process, share = load.worst_pegged
    return f"{100 * share:.0f} % ({process})"


def _download(path: Path) -> Markup:
    """A link that contains the file."""
    data = base64.b64encode(path.read_bytes()).decode()
    return Markup('<a download="{0}" href="data:text/csv;base64,{1}">{0}</a>').format(path.name, data)


def _ladder(folder: Path) -> str | None:
    """The ladder's picture as a data: URL; None without one."""
    try:
        data = read_regular(folder / LADDER, MAX_PICTURE_BYTES)
    except OSError:
        return None
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"


def _streams(runs: Iterable[Run]) -> dict[str, str]:
    """Descriptions of the DASH streams by mode, from the first run of each."""
    found: dict[str, str] = {}
    for run in runs:
        recording = run.record.recording
        if recording is not None and recording.dash is not None:
            found.setdefault(Controller.of(run.configuration).title_with_mode, recording.dash.summary)
    return found
