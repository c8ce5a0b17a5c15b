"""The page of a report: its template, filled with tables, figures and pictures."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tigas_common.files import read_regular
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.records.rerendered import SampledRun
from tigas_experiments.records.samples import MAX_PICTURE_BYTES
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.differences import Difference
from tigas_experiments.report.estimates import LEAST_BLOCKS, signed
from tigas_experiments.report.gallery import Snapshot, gallery, snapshots
from tigas_experiments.report.groups import Groups, Overall, Spread
from tigas_experiments.report.metrics import TABLE, Metric
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.rate_distortion import QUALITIES, by_condition, over_all
from tigas_experiments.report.results import LADDER, Results, Run
from tigas_experiments.report.run_listing import COLUMNS, AnyRun, by_network, cells, column_groups, titles
from tigas_experiments.report.tables import pegged_text, rtt_text
from tigas_experiments.wire.figures import INTERACTIVE_MS

MOST_RUNS = 16
"""Maximum number of runs of a network that are listed one by one."""


@dataclass(frozen=True, slots=True)
class Listing:
    """The runs over one network at one round trip, one by one."""

    label: str
    runs: list[AnyRun]
    titles: dict[str, str]
    snapshots: list[Snapshot]


@dataclass(frozen=True, slots=True)
class Page:
    """Contents of a report."""

    results: Results
    groups: Groups
    made: Sequence[AnyRun]
    """All runs with a readable record, in the order in which they were made."""
    totals: Sequence[Overall]
    baseline: Controller | None
    compared: Sequence[Difference]
    sampled: Mapping[str, SampledRun]
    warnings: list[str]
    plots: Mapping[str | None, list[Plot]]
    """Figures by network; None: over all networks."""
    csv_files: Sequence[Path]

    def html(self) -> str:
        """The rendered template, which escapes values unless they are markup."""
        environment = Environment(
            loader=PackageLoader("tigas_experiments.report"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        results, groups = self.results, self.groups
        records = sorted((run.record for run in results.runs), key=lambda record: record.started)
        return environment.get_template("report.html.j2").render(
            results=results,
            groups=groups,
            totals=self.totals,
            baseline=self.baseline,
            compared=self.compared,
            sampled=self.sampled,
            warnings=self.warnings,
            overview=self.plots.get(None, []),
            by_network={network: plots for network, plots in self.plots.items() if network is not None},
            listings=self._listings(),
            distortions=[
                one for one in (over_all(groups), *by_condition(groups)) if one is not None and one.equal_rates
            ],
            scored=any(run.scores for run in results.runs),
            samples=gallery(results, self.sampled),
            ladder=_ladder(results.folder),
            csv={path.name: _download(path) for path in self.csv_files},
            first=records[0] if records else None,
            scenes=sorted({record.configuration.scene for record in records}),
            movements=sorted({Path(record.configuration.movement).name for record in records}),
            networks={record.configuration.network.label: record.configuration.network for record in records},
            streams=_streams(records),
            table=TABLE,
            columns=COLUMNS,
            column_groups=column_groups(),
            qualities=QUALITIES,
            interactive_ms=f"{INTERACTIVE_MS:g}",
            least_blocks=LEAST_BLOCKS,
            cell=cell,
            cells=cells,
            signed=signed,
            rtt_text=rtt_text,
            pegged_text=pegged_text,
            file_name=lambda path: Path(path).name,
        )

    def _listings(self) -> dict[str, list[Listing]]:
        """Listings by network, for networks with figures of their own and at most MOST_RUNS runs per round trip."""
        found: dict[str, list[Listing]] = {}
        for label, runs in by_network(self.made).items():
            assert runs[0].record is not None
            network = runs[0].record.configuration.network.name
            if network in self.plots and len(runs) <= MOST_RUNS:
                named = titles(runs)
                complete = [run for run in runs if isinstance(run, Run)]
                pictures = snapshots(self.results.folder, complete, named)
                found.setdefault(network, []).append(Listing(label, runs, named, pictures))
        return found


def cell(spread: Spread | None, metric: Metric) -> tuple[str, str | None]:
    """Formatted mean and range; no range for equal values."""
    if spread is None:
        return metric.text(None), None
    low, high = metric.text(spread.low), metric.text(spread.high)
    return metric.text(spread.mean), None if low == high else f"{low}–{high}"


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


def _streams(records: Iterable[RunRecord]) -> dict[str, str]:
    """Descriptions of the DASH streams by mode, from the first run of each."""
    found: dict[str, str] = {}
    for record in records:
        if record.recording is not None and record.recording.dash is not None:
            found.setdefault(Controller.of(record.configuration).title_with_mode, record.recording.dash.summary)
    return found
