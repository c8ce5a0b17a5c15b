"""The figures of a comparison: over one network, a curve for each run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tigas_common.wire.figures import INTERACTIVE_MS
from tigas_experiments.report.charts import draw_distributions
from tigas_experiments.report.comparison_table import label
from tigas_experiments.report.controllers import Look, looks
from tigas_experiments.report.plot import (
    AREA,
    NO_METADATA,
    QUIET,
    Plot,
    add_legend,
    interactive_limit,
    panel_grid,
    plain_log,
    style,
    svg,
)
from tigas_experiments.report.results import Floats, Results, Run


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A run, and how it is called and drawn."""

    run: Run
    label: str
    look: Look

    @property
    def line(self) -> dict[str, Any]:
        """As matplotlib takes them for a line."""
        return {"label": self.label, **self.look.line}

    @property
    def rates(self) -> tuple[Floats, Floats]:
        """(s, Mbit/s) over the link; without a shaped link, what the page received."""
        if len(self.run.link):
            return self.run.link[:, 0], self.run.link[:, 2]
        times, received = self.run.received.T
        spans = np.diff(times)
        return times[1:][spans > 0], (np.diff(received) * 8e-6)[spans > 0] / spans[spans > 0]


def figures(results: Results) -> Iterator[tuple[str, list[Plot]]]:
    """Of the runs over each network."""
    for network, curves in _curves(results).items():
        with style():
            yield (
                network,
                [
                    _latency_distribution(curves),
                    _latency_over_time(curves),
                    _bandwidth_over_time(curves),
                    _height_over_time(curves),
                ],
            )


def write_headline(results: Results, folder: Path) -> None:
    """The distributions side by side, one network each, as headline.svg and headline.png. Raises OSError."""
    by_network = _curves(results)
    with style():
        figure = Figure(figsize=(4.4 * len(by_network), 3.1), layout="constrained")
        panels = figure.subplots(1, len(by_network), squeeze=False, sharey=True)[0]
        for axes, (network, curves) in zip(panels, by_network.items(), strict=True):
            _draw_distribution(axes, curves)
            axes.set_title(network, fontsize=9)
        for axes in panels[1:]:
            axes.set_ylabel("")
        add_legend(figure, panels)
        figure.savefig(folder / "headline.svg", metadata=NO_METADATA)
        figure.savefig(folder / "headline.png", dpi=160)


def _curves(results: Results) -> dict[str, list[Curve]]:
    """By network, in the order in which the runs were made."""
    look = looks(run.controller for run in results.runs)
    found: dict[str, list[Curve]] = {}
    for run in sorted(results.runs, key=lambda run: run.record.started):
        network = run.record.configuration.network.label
        found.setdefault(network, []).append(Curve(run, label(run.record), look[run.controller]))
    return found


def _latency_distribution(curves: Sequence[Curve]) -> Plot:
    figure, (axes,) = panel_grid(1)
    _draw_distribution(axes, curves)
    add_legend(figure, [axes])
    return Plot("latency", "Distribution of motion-to-photon latency", f"Dashed: {INTERACTIVE_MS:g} ms.", svg(figure))


def _latency_over_time(curves: Sequence[Curve]) -> Plot:
    figure, (axes,) = panel_grid(1)
    for curve in curves:
        times, latencies = curve.run.latencies.T
        axes.plot(times, np.where(np.isfinite(latencies), latencies, np.nan), linewidth=0.9, **curve.line)
    interactive_limit(axes)
    _over_time(axes, curves, "Motion-to-photon, ms")
    plain_log(axes, np.concatenate([curve.run.latencies[:, 1] for curve in curves]).tolist())
    _draw_rate_behind(axes, curves)
    add_legend(figure, [axes])
    title = "Motion-to-photon latency of each input"
    return Plot("latency-over-time", title, f"Dashed: {INTERACTIVE_MS:g} ms; grey: the link's rate.", svg(figure))


def _bandwidth_over_time(curves: Sequence[Curve]) -> Plot:
    figure, (axes,) = panel_grid(1)
    link = _link(curves)
    if len(link):
        axes.fill_between(link[:, 0], link[:, 1], color=AREA, step="post", label="Link's rate", linewidth=0)
    for curve in curves:
        axes.plot(*curve.rates, linewidth=1, **curve.line)
    _over_time(axes, curves, "Mbit/s")
    axes.set_ylim(bottom=0)
    add_legend(figure, [axes])
    caption = "Grey: the link's rate." if len(link) else "What the page received, as there was no shaped link."
    return Plot("bandwidth-over-time", "What crossed the link towards the viewer", caption, svg(figure))


def _height_over_time(curves: Sequence[Curve]) -> Plot:
    figure, (axes,) = panel_grid(1)
    for curve in curves:
        during = curve.run.heights[curve.run.heights[:, 0] <= curve.run.record.configuration.duration_s]
        axes.step(*during.T, where="post", **curve.line)
    _over_time(axes, curves, "Height of the frame, pixels")
    axes.set_ylim(bottom=0)
    add_legend(figure, [axes])
    return Plot("height-over-time", "Resolution on the screen", "", svg(figure))


def _draw_distribution(axes: Axes, curves: Sequence[Curve]) -> None:
    times = draw_distributions(axes, ((curve.label, curve.look, curve.run.latencies[:, 1]) for curve in curves))
    plain_log(axes, times, horizontal=True)


def _draw_rate_behind(axes: Axes, curves: Sequence[Curve]) -> None:
    link = _link(curves)
    if not len(link):
        return
    behind = axes.twinx()
    behind.fill_between(link[:, 0], link[:, 1], color=AREA, step="post", linewidth=0)
    behind.set_ylabel("Link, Mbit/s", color=QUIET)
    behind.tick_params(axis="y", colors=QUIET)
    behind.set_ylim(bottom=0)
    behind.grid(visible=False)
    behind.spines["right"].set_visible(True)
    axes.set_zorder(behind.get_zorder() + 1)
    axes.patch.set_visible(False)


def _over_time(axes: Axes, curves: Sequence[Curve], what: str) -> None:
    """The axes of a time series."""
    duration = max(curve.run.record.configuration.duration_s for curve in curves)
    axes.set(xlabel="Time, s", ylabel=what, xlim=(0, duration))


def _link(curves: Sequence[Curve]) -> Floats:
    """Of the first run that has one: all have the same."""
    return next((curve.run.link for curve in curves if len(curve.run.link)), np.empty((0, 3)))
