"""The figures of an experiment: one line, point or curve per controller, with the same look throughout.

Figures without data are omitted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tigas_experiments.records.statistics import IN_TIME
from tigas_experiments.report.controllers import Controller, LineLook
from tigas_experiments.report.groups import Group, Groups, describe_run_counts
from tigas_experiments.report.metrics import PART_TITLES, Metric, select_metrics
from tigas_experiments.report.plot import (
    MOST_COLUMNS,
    PAPER,
    WIDE_IN,
    Plot,
    interactive_limit,
    label_lowest,
    panel_grid,
    plain_log,
    plot_style,
    shorten,
)
from tigas_experiments.report.quality_figures import enhancement_heat_map, quality, quality_heat_map, quality_over_all
from tigas_experiments.report.time_figures import (
    bandwidth,
    frame_ages,
    frame_ages_over_time,
    heights_over_time,
    latencies,
)

OVERVIEW = select_metrics(
    "motion_to_photon_p50_ms",
    "motion_to_photon_p95_ms",
    IN_TIME,
    "frame_age_mean_ms",
    "new_views_per_s",
    "render_mean_ms",
    "received_mbit_s",
    "mean_height_px",
    "median_height_px",
    "mean_profile",
    "profile_changes_per_min",
    "seen_ssim",
)
OVER_RTT = select_metrics(
    "response_time_mean_ms",
    "frame_age_mean_ms",
    "motion_to_photon_p95_ms",
    "mean_profile",
    "profile_changes_per_min",
    IN_TIME,
    "median_height_px",
    "received_mbit_s",
    "new_views_per_s",
)
PARTS = select_metrics(*(f"age_{part}_ms" for part in PART_TITLES))
PART_COLOURS = ("#bbbbbb", "#88ccee", "#0072b2", "#44aa99", "#d55e00", "#cc79a7", "#ddcc77")
LOGARITHMIC_FROM = 8.0
"""Ratio of times above which their axis is logarithmic."""
MOST_NETWORKS = 8
"""Maximum number of networks with their own figures; tables and CSV files cover all networks."""


def figures(groups: Groups) -> Iterator[tuple[str | None, Plot]]:
    """All figures in page order, each with its network (None: all networks)."""
    for draw in OVERVIEW_FIGURES.values():
        with plot_style():
            plot = draw(groups)
        if plot is not None:
            yield None, plot
    for number, network in enumerate(groups.networks[:MOST_NETWORKS], 1):
        slug = f"{number:02}-" + (re.sub(r"[^A-Za-z0-9.-]+", "-", network).strip(".-")[:40] or "network")
        for draw_network in NETWORK_FIGURES:
            with plot_style():
                plot = draw_network(groups, network)
            if plot is not None:
                yield network, replace(plot, name=f"{slug}_{plot.name}")


def overview(groups: Groups) -> Plot | None:
    """Latency, resolution, bandwidth and switches of each controller over each network."""
    metrics = _existing(OVERVIEW, groups)
    if not metrics:
        return None
    looks, networks = groups.looks, groups.networks
    figure, panels = panel_grid(len(metrics))
    step = 0.7 / len(looks)
    places = {controller: (place - (len(looks) - 1) / 2) * step for place, controller in enumerate(looks)}
    tilted: dict[str, Any] = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}
    own = groups.lowest
    for axes, metric in zip(panels, metrics, strict=True):
        at = {group: networks.index(group.condition.network) + places[group.controller] for group in own}
        _draw_estimates(axes, at, metric, looks, linestyle="none")
        names = [shorten(name) for name in networks]
        axes.set_xticks(range(len(names)), names, **(tilted if len(names) > MOST_COLUMNS else {}))
        axes.set_xlim(-0.5, len(names) - 0.5)
        axes.grid(visible=False, axis="x")
    label_lowest(panels)
    caption = f"Each controller over each network, {groups.lowest_title}. {describe_run_counts(own)}"
    return Plot.from_figure(figure, panels, "overview", "Overview", caption)


def over_rtt(groups: Groups, network: str) -> Plot | None:
    """Metrics against the round-trip time; None with fewer than two round trips."""
    rtts = groups.rtts(network)
    if len(rtts) < 2:
        return None
    at = {group: rtt for rtt in rtts for group in groups.at(network, rtt)}
    metrics = _existing(OVER_RTT, [*at])
    figure, panels = panel_grid(len(metrics))
    for axes, metric in zip(panels, metrics, strict=True):
        _draw_estimates(axes, at, metric, groups.looks)
        axes.set_xlabel("Round trip, ms")
        axes.set_xticks(rtts, [f"{rtt:g}" for rtt in rtts])
    caption = f"Over {network}; lines and whiskers: {describe_run_counts([*at])}"
    return Plot.from_figure(figure, panels, "rtt", "Effect of the round trip", caption)


def _draw_estimates(
    axes: Axes, at: Mapping[Group, float], metric: Metric, looks: Mapping[Controller, LineLook], **line: Any
) -> None:
    """Draw each controller's means at these positions, with whiskers to the lowest and highest run, on a scaled axis.

    A hollow marker at the upper edge stands for a run in which too many inputs were never answered.
    """
    found = [(group.controller, x, each) for group, x in at.items() if (each := group.estimate(metric))]
    for controller, look in looks.items():
        own = [(x, each) for name, x, each in found if name == controller]
        if endless := [x for x, each in own if math.isinf(each.high)]:
            edge = axes.get_xaxis_transform()
            shape: dict[str, Any] = {"marker": look.marker, "color": look.colour, "linestyle": "none", "mfc": "none"}
            axes.plot(endless, [1.0] * len(endless), transform=edge, clip_on=False, **shape)
        points = [(x, each.mean, each.mean - each.low, each.high - each.mean) for x, each in own if x not in endless]
        if points:
            x, mean, below, above = zip(*points, strict=True)
            shape = {"marker": look.marker, "markersize": 5, "linewidth": 1.3, "label": controller.title}
            axes.errorbar(x, mean, yerr=(below, above), **shape, **{**look.line, **line})
    _scale(axes, metric, [value for _, _, each in found for value in (each.low, each.high) if math.isfinite(value)])


def _scale(axes: Axes, metric: Metric, values: Sequence[float]) -> None:
    """Title a panel with its metric and scale its vertical axis to the values."""
    profile = metric.name == "mean_profile"
    better = "" if metric.better is None or profile else f" ({metric.better}er is better)"
    axes.set_title(metric.heading + better)
    if metric.unit == "ms" and values and max(values) > LOGARITHMIC_FROM * min(values) > 0:
        plain_log(axes, values)
    else:
        axes.set_ylim(bottom=0)
    if profile:
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_ylim(max([1.0, *values]) + 0.2, -0.2)
    elif metric.name == IN_TIME:
        axes.set_ylim(0, 102)
    if metric.unit == "ms":
        interactive_limit(axes)


def latency_parts(groups: Groups) -> Plot | None:
    """Parts of the mean frame age, stacked. None without server times."""
    parts = {group: [each.mean for metric in PARTS if (each := group.estimate(metric))] for group in groups.lowest}
    known = [group for group, values in parts.items() if values]
    if not known:
        return None
    several = len({group.condition.network for group in known}) > 1
    labels = [group.controller.title + f", {shorten(group.condition.network)}" * several for group in known]
    values = zip(*(parts[group] for group in known), strict=True)
    bars = {
        title: (colour, each) for title, colour, each in zip(PART_TITLES.values(), PART_COLOURS, values, strict=True)
    }
    figure, axes = _stacked_bars(labels, bars)
    axes.set(xlabel="Mean frame age, ms (lower is better)", xlim=(0, None))
    caption = (
        f"Each controller over each network, {groups.lowest_title}. {describe_run_counts(groups.lowest)} Network "
        "includes both directions; the last part includes decoding and the wait for the display."
    )
    return Plot.from_figure(figure, [axes], "latency-parts", "Parts of the frame age", caption)


def profiles(groups: Groups, network: str) -> Plot | None:
    """Share of time for which each profile was on screen."""
    own = [group for group in groups.base(network) if any(run.profile_shares for run in group.runs)]
    if not own:
        return None
    rungs = sorted({rung for group in own for run in group.runs for rung in run.profile_shares})
    bars = {}
    for rung in rungs:
        shade = 0.25 + 0.6 * rung / max(1, rungs[-1])  # dark for the best profile
        shares = [np.mean([100 * run.profile_shares.get(rung, 0.0) for run in group.runs]) for group in own]
        bars[f"Profile {rung}"] = ((0.15 + 0.75 * shade, 0.3 + 0.6 * shade, 0.5 + 0.42 * shade), shares)
    figure, axes = _stacked_bars([group.controller.title for group in own], bars)
    axes.set(xlabel="Share of the time, %", xlim=(0, 100))
    caption = f"Over {groups.base_title(network)}; 0 is the best profile. Means over the runs."
    return Plot.from_figure(figure, [axes], "profiles", "Profiles on the screen", caption)


def _stacked_bars(labels: Sequence[str], parts: Mapping[str, tuple[Any, Sequence[Any]]]) -> tuple[Figure, Axes]:
    """A horizontal bar for each label, made of consecutive parts: colour and lengths by title."""
    figure, (axes,) = panel_grid(1, width=WIDE_IN, height=0.5 + 0.32 * len(labels))
    left = np.zeros(len(labels))
    for title, (colour, lengths) in parts.items():
        axes.barh(range(len(labels)), lengths, left=left, color=colour, label=title, edgecolor=PAPER, height=0.75)
        left += lengths
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    return figure, axes


def _existing(metrics: Sequence[Metric], groups: Sequence[Group]) -> list[Metric]:
    return [metric for metric in metrics if any(group.estimate(metric) for group in groups)]


OVERVIEW_FIGURES: dict[str, Callable[[Groups], Plot | None]] = {
    "overview": overview,
    "latency-parts": latency_parts,
    "quality-heatmap": quality_heat_map,
    "enhancement-heatmap": enhancement_heat_map,
    "rate-distortion": quality_over_all,
}
"""Figures over all networks, by file name."""
FIGURE_FILES = ("headline.svg", "[0-9][0-9]-*_*.svg", *(f"{name}.svg" for name in OVERVIEW_FIGURES))
"""Patterns of the files with a report's figures."""
NETWORK_FIGURES: tuple[Callable[[Groups, str], Plot | None], ...] = (
    over_rtt,
    latencies,
    frame_ages,
    frame_ages_over_time,
    heights_over_time,
    profiles,
    bandwidth,
    quality,
)
