"""Listings of single runs by network, with the same columns in the terminal, Markdown and HTML."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TypeAlias

from rich.cells import cell_len
from rich.table import Table

from tigas_experiments.records.folder import RunRecord
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.metrics import IN_TIME, METRICS, NONE
from tigas_experiments.report.results import Failure, Results, Run
from tigas_experiments.report.tables import escaped
from tigas_experiments.wire.figures import INTERACTIVE_MS

GAP = 2
"""Spaces between columns in the terminal."""
AnyRun: TypeAlias = Run | Failure
"""A run with a readable record."""


@dataclass(frozen=True, slots=True)
class Column:
    """One figure of a run."""

    group: str
    title: str
    metric: str
    """Name in `METRICS`."""
    short: str | None = None
    """Heading in the Markdown table, which has only the most important figures."""

    @property
    def unit(self) -> str:
        """The metric's unit."""
        return METRICS[self.metric].unit

    @property
    def heading(self) -> str:
        """Title and unit within the group."""
        return f"{self.title}, {self.unit}" if self.unit else self.title

    def cell(self, run: AnyRun) -> str:
        """Formatted value without its unit."""
        return METRICS[self.metric].text(run.values[self.metric]) if isinstance(run, Run) else NONE


LATENCY, TURNING, FRAMES, BANDWIDTH = "Motion-to-photon", "View latency", "Frames", "Bandwidth"
PICTURE, VIEW, DISPLAY = "Picture", "View", "At display time"
COLUMNS = (
    Column(LATENCY, "p50", "motion_to_photon_p50_ms", "p50, ms"),
    Column(LATENCY, "p95", "motion_to_photon_p95_ms", "p95, ms"),
    Column(LATENCY, "p99", "motion_to_photon_p99_ms", "p99, ms"),
    Column(LATENCY, f"within {INTERACTIVE_MS:g} ms", IN_TIME, f"within {INTERACTIVE_MS:g} ms, %"),
    Column(TURNING, "p50", "view_latency_p50_ms"),
    Column(TURNING, "p95", "view_latency_p95_ms", "view latency p95, ms"),
    Column(FRAMES, "new views", "new_views_per_s", "new views/s"),
    Column(FRAMES, "freezes", "freezes_per_min", "freezes/min"),
    Column(FRAMES, "frozen", "frozen_s", "frozen, s"),
    Column(FRAMES, "height", "mean_height_px", "height, px"),
    Column(BANDWIDTH, "received", "received_mbit_s", "Mbit/s"),
    Column(BANDWIDTH, "over the link", "over_link_mbit_s"),
    Column(PICTURE, "SSIM", "picture_ssim", "SSIM of the picture"),
    Column(PICTURE, "PSNR", "picture_psnr_db"),
    Column(VIEW, "SSIM", "view_ssim", "SSIM of the view"),
    Column(VIEW, "PSNR", "view_psnr_db"),
    Column(DISPLAY, "SSIM", "seen_ssim", "SSIM at display time"),
    Column(DISPLAY, "PSNR", "seen_psnr_db"),
    Column(DISPLAY, "content age", "content_age_mean_ms", "content age, ms"),
    Column(DISPLAY, "border never covered", "border_never_seen_pct"),
)


def column_groups() -> list[tuple[str, int]]:
    """Groups of columns with their sizes."""
    return [(name, len(list(members))) for name, members in groupby(COLUMNS, lambda column: column.group)]


def runs_as_made(results: Results) -> list[AnyRun]:
    """All runs with a readable record, in the order in which they were made."""
    found: list[tuple[str, str, AnyRun]] = [(run.record.started, run.folder, run) for run in results.runs]
    found += [(one.record.started, one.folder, one) for one in results.failures if one.record is not None]
    return [run for *_, run in sorted(found, key=lambda each: each[:2])]


def label(record: RunRecord) -> str:
    """Name of a run within its network."""
    configuration = record.configuration
    name = Controller.of(configuration).title_with_mode
    return f"{name} ({configuration.repeat + 1})" if configuration.repeat else name


def cells(run: AnyRun) -> list[str]:
    """One cell per column."""
    return [column.cell(run) for column in COLUMNS]


def titles(runs: Sequence[AnyRun]) -> dict[str, str]:
    """Distinct names of runs over one network, by folder."""
    configurations = {run.folder: _record(run).configuration for run in runs}
    several = {
        name: len({getattr(configuration, name) for configuration in configurations.values()}) > 1
        for name in ("scene", "movement", "segment")
    }
    return {
        run.folder: ", ".join(
            [label(_record(run))]
            + ([configuration.scene] if several["scene"] else [])
            + ([Path(configuration.movement).stem] if several["movement"] else [])
            + ([f"part {configuration.segment + 1}"] if several["segment"] else [])
        )
        for run, configuration in zip(runs, configurations.values(), strict=True)
    }


def by_network(runs: Iterable[AnyRun]) -> dict[str, list[AnyRun]]:
    """Runs by network in their order, with the runs of one controller together."""
    found: dict[str, dict[str, list[AnyRun]]] = {}
    for run in runs:
        own = found.setdefault(_record(run).configuration.network.label, {})
        own.setdefault(label(_record(run)), []).append(run)
    return {network: [run for alike in own.values() for run in alike] for network, own in found.items()}


def markdown(runs: Iterable[AnyRun]) -> str:
    """One table for all networks, with the most important figures; the first three are motion-to-photon latencies."""
    chosen = [column for column in COLUMNS if column.short]
    lines = [
        "| network | mode | " + " | ".join(column.short or "" for column in chosen) + " |",
        "|---|---|" + "---:|" * len(chosen),
    ]
    for network, own in by_network(runs).items():
        named = titles(own)
        for run in own:
            if isinstance(run, Failure):
                row = [f"no result: {run.reason}", *[""] * (len(chosen) - 1)]
            else:
                row = [column.cell(run) for column in chosen]
            lines.append(f"| {' | '.join(map(escaped, (network, named[run.folder], *row)))} |")
    return "\n".join(lines) + "\n"


def in_terminal(network: str, runs: Sequence[AnyRun], width: int) -> Iterator[Table]:
    """A column per run over a network, without figures that all runs lack; split into tables that fit the width.

    Names break between words and are never cut.
    """
    lines: list[tuple[str, list[str]]] = []
    for group, members in groupby(COLUMNS, lambda column: column.group):
        known = [(f"  {column.heading}", [column.cell(run) for run in runs]) for column in members]
        known = [(heading, cells) for heading, cells in known if set(cells) != {NONE}]
        lines += [(group, [""] * len(runs)), *known] if known else []
    if not lines:
        return
    names = list(titles(runs).values())
    headings = max(cell_len(heading) for heading, _ in lines)
    room = width - headings
    columns = [
        min(max(1, room - GAP), max(map(cell_len, (*name.split(), *(cells[place] for _, cells in lines)))))
        for place, name in enumerate(names)
    ]
    end = 0
    while (begin := end) < len(names):
        while end < len(names) and (end == begin or sum(columns[begin : end + 1]) + GAP * (end + 1 - begin) <= room):
            end += 1
        table = Table(title=network, title_justify="left", box=None, padding=(0, 0, 0, GAP), pad_edge=False)
        table.add_column("", width=headings)
        for place in range(begin, end):
            table.add_column(names[place], justify="right", width=columns[place], overflow="fold")
        for heading, cells in lines:
            table.add_row(heading, *cells[begin:end], style=None if any(cells) else "bold")
        yield table


def _record(run: AnyRun) -> RunRecord:
    assert run.record is not None
    return run.record
