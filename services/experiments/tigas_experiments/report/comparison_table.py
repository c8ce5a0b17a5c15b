"""The table of a comparison, run by run: the same for the terminal, Markdown and HTML."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from tigas_common.wire.figures import INTERACTIVE_MS
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.records.summary import Summary
from tigas_experiments.report import metrics
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.metrics import NONE, Metric
from tigas_experiments.report.results import Results
from tigas_experiments.report.tables import escaped


@dataclass(frozen=True, slots=True)
class Column:
    """One figure of a run."""

    group: str
    title: str
    metric: Metric
    short: str | None = None
    """Its heading in the Markdown table, which has the most important ones alone."""

    @property
    def heading(self) -> str:
        """By itself."""
        heading = f"{self.group}: {self.title}"
        return f"{heading}, {self.metric.unit}" if self.metric.unit else heading

    def cell(self, summary: Summary) -> str:
        """Of a run, without the unit."""
        if summary.figures is None:
            return NONE
        return self.metric.text(self.metric.of(summary.record, summary.figures))


LATENCY, TURNING, FRAMES, BANDWIDTH = "Motion-to-photon", "View latency", "Frames", "Bandwidth"
PICTURE, VIEW, SEEN = "Picture", "View", "Seen"
COLUMNS = (
    Column(LATENCY, "p50", metrics.PHOTON_P50, "p50, ms"),
    Column(LATENCY, "p95", metrics.PHOTON_P95, "p95, ms"),
    Column(LATENCY, "p99", metrics.PHOTON_P99, "p99, ms"),
    Column(LATENCY, f"within {INTERACTIVE_MS:g} ms", metrics.IN_TIME, f"within {INTERACTIVE_MS:g} ms, %"),
    Column(TURNING, "p50", metrics.VIEW_LATENCY_P50),
    Column(TURNING, "p95", metrics.VIEW_LATENCY_P95, "view latency p95, ms"),
    Column(FRAMES, "new views", metrics.NEW_VIEWS, "new views/s"),
    Column(FRAMES, "freezes", metrics.FREEZES, "freezes/min"),
    Column(FRAMES, "frozen", metrics.FROZEN, "frozen, s"),
    Column(FRAMES, "height", metrics.HEIGHT, "height, px"),
    Column(BANDWIDTH, "received", metrics.RECEIVED, "Mbit/s"),
    Column(BANDWIDTH, "over the link", metrics.OVER_LINK),
    Column(PICTURE, "SSIM", metrics.PICTURE_SSIM, "SSIM of the picture"),
    Column(PICTURE, "PSNR", metrics.PICTURE_PSNR),
    Column(VIEW, "SSIM", metrics.VIEW_SSIM, "SSIM of the view"),
    Column(VIEW, "PSNR", metrics.VIEW_PSNR),
    Column(SEEN, "SSIM", metrics.SEEN_SSIM, "SSIM of what is seen"),
    Column(SEEN, "PSNR", metrics.SEEN_PSNR),
    Column(SEEN, "content age", metrics.CONTENT_AGE_MEAN, "content age, ms"),
    Column(SEEN, "border never seen", metrics.UNCOVERED),
)


def column_groups() -> list[tuple[str, int]]:
    """The columns' groups, and how many columns each has."""
    return [(name, len(list(members))) for name, members in groupby(COLUMNS, lambda column: column.group)]


def runs_as_made(results: Results) -> list[Summary]:
    """All runs of which run.json can be read, in the order in which they were made."""
    runs = [Summary(folder=r.folder, record=r.record, figures=r.figures, problem=None) for r in results.runs]
    for failure in results.failures:
        if failure.record is not None:
            runs.append(Summary(folder=failure.folder, record=failure.record, figures=None, problem=failure.reason))
    return sorted(runs, key=lambda run: (run.record.started, run.folder))


def label(record: RunRecord) -> str:
    """The run within its network."""
    configuration = record.configuration
    name = Controller.of(configuration).title_with_mode
    return f"{name} ({configuration.repeat + 1})" if configuration.repeat else name


def cells(summary: Summary) -> list[str]:
    """One per column; all empty without figures."""
    return [column.cell(summary) for column in COLUMNS]


def titles(summaries: Sequence[Summary]) -> dict[str, str]:
    """Of runs over one network, by their folders: with what tells those of one controller apart."""
    configurations = {summary.folder: summary.record.configuration for summary in summaries}
    several = {
        name: len({getattr(configuration, name) for configuration in configurations.values()}) > 1
        for name in ("scene", "movement", "segment")
    }
    return {
        summary.folder: ", ".join(
            [label(summary.record)]
            + ([configuration.scene] if several["scene"] else [])
            + ([Path(configuration.movement).stem] if several["movement"] else [])
            + ([f"part {configuration.segment + 1}"] if several["segment"] else [])
        )
        for summary, configuration in zip(summaries, configurations.values(), strict=True)
    }


def by_network(summaries: Iterable[Summary]) -> dict[str, list[Summary]]:
    """In the order that they have, but runs of one controller together."""
    found: dict[str, dict[str, list[Summary]]] = {}
    for summary in summaries:
        runs = found.setdefault(summary.record.configuration.network.label, {})
        runs.setdefault(label(summary.record), []).append(summary)
    return {network: [run for alike in runs.values() for run in alike] for network, runs in found.items()}


def markdown(summaries: Iterable[Summary]) -> str:
    """One table for all networks, with the most important figures; the first three are motion-to-photon latencies."""
    chosen = [column for column in COLUMNS if column.short]
    lines = [
        "| network | mode | " + " | ".join(column.short or "" for column in chosen) + " |",
        "|---|---|" + "---:|" * len(chosen),
    ]
    for network, runs in by_network(summaries).items():
        named = titles(runs)
        for run in runs:
            if run.figures is None:
                row = [f"no result: {run.problem}", *[""] * (len(chosen) - 1)]
            else:
                row = [column.cell(run) for column in chosen]
            lines.append(f"| {' | '.join(map(escaped, (network, named[run.folder], *row)))} |")
    return "\n".join(lines) + "\n"
