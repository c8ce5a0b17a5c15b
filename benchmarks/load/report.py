"""Results as a text table, as JSON, and as a chart."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic_core import to_json
from rich.box import SIMPLE_HEAD
from rich.table import Table

from benchmarks.load.measure import Capacity, Comparison
from benchmarks.load.step import Interval, Step
from tigas_experiments.report.plot import INK, QUIET, panel_grid, plain_log, plot_style, svg

COLUMNS = (
    "viewers", "frames/s", "served", "p50, ms", "p95, ms", "Mbit/s", "kB", "server, cores", "MB", "files",
    "viewers' processes",
)  # fmt: skip
FIGURES: dict[str, Callable[[Step], float]] = {
    "p50": lambda step: step.p50_ms,
    "p95": lambda step: step.p95_ms,
    "frames/s": lambda step: step.frames_per_s,
}
"""That are compared."""


def line(step: Step) -> str:
    """A step while the next is measured."""
    return (
        f"{step.viewers:4} viewers: {step.frames_per_s:7,.0f} frames/s, p50 {step.p50_ms:6.1f}, "
        f"p95 {step.p95_ms:6.1f} ms, {100 * step.served:6.2f} % served; {_lost(step)}"
    ).rstrip("; ")


def table(steps: Sequence[Step], title: str) -> Table:
    """A row for each step."""
    shown = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    for column in COLUMNS:
        shown.add_column(column, justify="right")
    shown.add_column("not served")
    for step in steps:
        shown.add_row(*_cells(step), _lost(step))
    return shown


def _cells(step: Step) -> list[str]:
    generator, server = step.generator, step.server
    used = (
        ["", "", ""] if server is None else [f"{server.cores:.2f}", f"{server.megabytes:.0f}", f"{server.open_files}"]
    )
    return [
        str(step.viewers),
        f"{step.frames_per_s:,.0f} {_interval(step.frames_interval, 0)}",
        f"{100 * step.served:.2f} %",
        f"{step.p50_ms:.1f} {_interval(step.p50_interval, 1)}",
        f"{step.p95_ms:.1f} {_interval(step.p95_interval, 1)}",
        f"{step.mbit_per_s:.0f}",
        f"{step.kilobytes:.1f}",
        *used,
        f"{100 * generator.cpu:.0f} %, {generator.cpu_ms:.2f} ms a frame, {generator.lag_p95_ms:.1f} ms late",
    ]


def _lost(step: Step) -> str:
    told = [f"{count:,} {fate}" for fate, count in step.lost.items()]
    if step.outside:
        told.append(f"{step.outside} viewers outside")
    if step.bottleneck:
        told.append(f"beware: {step.bottleneck}")
    return ", ".join(told)


def _interval(interval: Interval, digits: int) -> str:
    low, high = interval
    return "" if math.isnan(low) else f"[{low:,.{digits}f}, {high:,.{digits}f}]"


def verdict(capacity: Capacity) -> list[str]:
    """Findings, a sentence each."""
    peak = max((step.frames_per_s for step in (*capacity.steps, *capacity.beyond)), default=0.0)
    return [_most(capacity), *(_beyond(step, capacity.viewers, peak) for step in capacity.beyond)]


def _beyond(step: Step, viewers: int, peak: float) -> str:
    inside, share = step.viewers - step.outside, 100 * step.frames_per_s / peak if peak else 0.0
    return (
        f"Offered {step.viewers / viewers:.2g} times as many, {step.viewers}: "
        f"{inside} inside, p50 {step.p50_ms:.1f} ms, p95 {step.p95_ms:.1f} ms, "
        f"{step.frames_per_s:,.0f} frames/s, {share:.0f} % of the most."
    )


def _most(capacity: Capacity) -> str:
    limit = f"p95 ≤ {capacity.limit_ms:g} ms and all served"
    if capacity.viewers and capacity.found:
        return f"{capacity.viewers} viewers are the most with {limit}."
    if capacity.viewers:
        why = "more were not tried, or the viewers' own processes were too slow for more"
        return f"At least {capacity.viewers} viewers have {limit}: {why}."
    bound = next((step.bottleneck for step in capacity.steps if step.bottleneck), None)
    if bound:
        return f"Nothing is known of the service: {bound}. Give the viewers more processes or cores."
    return f"No number of viewers that was tried has {limit}."


def comparison_lines(comparison: Comparison) -> list[str]:
    """How many times the baseline's, figure by figure."""
    lines = []
    for name, figure in FIGURES.items():
        ratio = comparison.ratio(figure)
        told = "nothing to compare"
        if ratio is not None:
            interval = _interval(ratio.interval, 3) if ratio.interval else "(too few pairs for an interval)"
            told = f"{ratio.value:.3f} times the baseline's {interval}"
        lines.append(f"{comparison.viewers} viewers, {name}: {told}")
    return lines


def write_json(path: Path, steps: Sequence[Step], figures: dict[str, Any]) -> None:
    """All results for programs; unknown values are null."""
    told = [{**asdict(step), "served": step.served, "bottleneck": step.bottleneck} for step in steps]
    path.write_bytes(to_json({**figures, "steps": told}, indent=1, inf_nan_mode="null"))


def draw(capacity: Capacity, frames_per_s: float, title: str, path: Path) -> None:
    """Latency and frames over the number of viewers, up to the knee and beyond."""
    every = sorted([*capacity.steps, *capacity.beyond], key=lambda step: step.viewers)
    steps = [step for step in every if step.bottleneck is None and not math.isnan(step.p95_ms)]
    if not steps:
        return
    viewers = [step.viewers for step in steps]
    with plot_style():
        figure, (latency, frames) = panel_grid(2, width=4.9)
        for name, values, intervals, colour in (
            ("p95", [step.p95_ms for step in steps], [step.p95_interval for step in steps], "#b3452c"),
            ("p50", [step.p50_ms for step in steps], [step.p50_interval for step in steps], "#2c6fb3"),
        ):
            latency.plot(viewers, values, marker="o", markersize=3.5, linewidth=1.2, color=colour, label=name)
            low, high = zip(*intervals, strict=True)
            latency.fill_between(viewers, low, high, color=colour, alpha=0.2, linewidth=0)
        plain_log(latency, [step.p95_ms for step in steps] + [step.p50_ms for step in steps])
        latency.axhline(capacity.limit_ms, color=INK, linewidth=0.8, linestyle="--")
        latency.set_title("From a request to its frame's last byte, ms")
        latency.legend(loc="upper left")
        wanted = [0, max(viewers)]
        frames.plot(wanted, [frames_per_s * count for count in wanted], color=QUIET, linewidth=0.8, label="wanted")
        frames.plot(
            viewers, [step.frames_per_s for step in steps], marker="o", markersize=3.5, linewidth=1.2,
            color="#2c6fb3", label="delivered",
        )  # fmt: skip
        frames.set_ylim(bottom=0)
        frames.set_title("Frames/s")
        frames.legend(loc="upper left")
        for panel in (latency, frames):
            panel.set_xlabel("viewers")
            panel.set_xlim(left=0)
            if capacity.viewers:
                panel.axvline(capacity.viewers, color=QUIET, linewidth=0.8, linestyle=":")
        figure.suptitle(title, fontsize=9, x=0.01, ha="left")
        path.write_text(svg(figure), encoding="utf-8")
