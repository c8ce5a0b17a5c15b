"""Listings of single runs by network, with the same columns in the terminal, Markdown and HTML."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from rich.cells import cell_len
from rich.table import Table

from tigas_experiments.records.statistics import IN_TIME
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.metrics import METRICS, NONE
from tigas_experiments.report.run_table import Run
from tigas_experiments.report.tables import markdown_table
from tigas_experiments.wire.figures import INTERACTIVE_MS

GAP = 2
"""Number of spaces between columns in the terminal."""


@dataclass(frozen=True, slots=True)
class Column:
    group: str
    title: str
    metric: str
    """Name in `METRICS`."""
    short: str | None = None
    """Heading in the Markdown table, which has only the most important metrics."""

    @property
    def unit(self) -> str:
        return METRICS[self.metric].unit

    def cell(self, run: Run) -> str:
        return METRICS[self.metric].text(run.values.get(self.metric))


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
COLUMN_GROUPS = [(name, list(members)) for name, members in groupby(COLUMNS, lambda column: column.group)]


def run_label(run: Run) -> str:
    name, repeat = Controller.from_configuration(run.configuration).title_with_mode, run.configuration.repeat
    return f"{name} ({repeat + 1})" if repeat else name


def titles(runs: Sequence[Run]) -> list[str]:
    several = [
        name for name in ("scene", "movement", "segment") if len({getattr(run.configuration, name) for run in runs}) > 1
    ]

    def title(run: Run) -> str:
        each = run.configuration
        parts = {"scene": each.scene, "movement": Path(each.movement).stem, "segment": f"part {each.segment + 1}"}
        return ", ".join((run_label(run), *(parts[name] for name in several)))

    return [title(run) for run in runs]


def by_network(runs: Iterable[Run]) -> dict[str, list[Run]]:
    """Runs by network in their original order, with runs of the same controller together."""
    found: dict[str, dict[str, list[Run]]] = {}
    for run in runs:
        found.setdefault(run.configuration.network.label, {}).setdefault(run_label(run), []).append(run)
    return {network: [run for alike in own.values() for run in alike] for network, own in found.items()}


def markdown(runs: Iterable[Run]) -> str:
    """One table for all networks, with the most important metrics; the first three are motion-to-photon latencies."""
    chosen = [column for column in COLUMNS if column.short]
    rows = []
    for network, own in by_network(runs).items():
        for run, title in zip(own, titles(own), strict=True):
            if run.problem is None:
                cells = [column.cell(run) for column in chosen]
            else:
                cells = [f"no result: {run.problem}", *[""] * (len(chosen) - 1)]
            rows.append([network, title, *cells])
    headings = ["network", "mode", *(column.short or "" for column in chosen)]
    return markdown_table(headings, rows, left=headings[:2])


def terminal_tables(network: str, runs: Sequence[Run], width: int) -> Iterator[Table]:
    """One column per run over a network, without metrics that all runs lack, split into tables that fit the width.

    Names break between words and are never truncated.
    """
    lines: list[tuple[str, list[str]]] = []
    for group, members in COLUMN_GROUPS:
        known = []
        for column in members:
            cells = [column.cell(run) for run in runs]
            if set(cells) != {NONE}:
                unit = f", {column.unit}" if column.unit else ""
                known.append((f"  {column.title}{unit}", cells))
        lines += [(group, [""] * len(runs)), *known] if known else []
    if not lines:
        return
    headings = max(cell_len(heading) for heading, _ in lines)
    room = width - headings
    columns = []
    """Heading, width and cells of each run."""
    for place, name in enumerate(titles(runs)):
        cells = [cells[place] for _, cells in lines]
        columns.append((name, min(max(1, room - GAP), max(map(cell_len, (*name.split(), *cells)))), cells))
    while columns:
        table = Table(title=network, title_justify="left", box=None, padding=(0, 0, 0, GAP), pad_edge=False)
        table.add_column("", width=headings)
        count = 1
        while count < len(columns) and sum(GAP + column[1] for column in columns[: count + 1]) <= room:
            count += 1
        for name, size, _ in columns[:count]:
            table.add_column(name, justify="right", width=size, overflow="fold")
        for place, (heading, cells) in enumerate(lines):
            own = [column[2][place] for column in columns[:count]]
            table.add_row(heading, *own, style=None if any(cells) else "bold")
        yield table
        columns = columns[count:]
