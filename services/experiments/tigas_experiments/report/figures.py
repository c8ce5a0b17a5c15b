"""The figures of an experiment: one line, point or curve per controller, with the same look throughout.

Figures without data are left out.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tigas_experiments.report.charts import (
    BINS,
    Looks,
    binned,
    downloaded,
    draw_boxes,
    draw_distributions,
    draw_line,
    draw_points,
    received,
)
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.latency_parts import PART_TITLES
from tigas_experiments.report.metrics import IN_TIME, Metric, chosen
from tigas_experiments.report.plot import (
    AREA,
    INK,
    MOST_COLUMNS,
    NO_METADATA,
    PANEL_IN,
    PAPER,
    Plot,
    add_legend,
    extent,
    finish,
    interactive_limit,
    label_lowest,
    metric_axis,
    panel_grid,
    plain_log,
    short,
    style,
)
from tigas_experiments.report.quality_figures import enhancement_heat_map, quality_heat_map, rate_distortion_plot
from tigas_experiments.report.rate_distortion import RateDistortion, over_all
from tigas_experiments.report.results import Floats
from tigas_experiments.wire.figures import INTERACTIVE_MS

WIDE = 2.6
"""Width of a panel with a time series, in panels."""
OVERVIEW = chosen(
    "motion_to_photon_p50_ms",
    "motion_to_photon_p95_ms",
    IN_TIME,
    "frame_age_mean_ms",
    "new_views_per_s",
    "render_mean_ms",
    "received_mbit_s",
    "mean_height_px",
    "mean_profile",
    "profile_changes_per_min",
)
OVER_RTT = chosen(
    "frame_age_mean_ms",
    "motion_to_photon_p95_ms",
    IN_TIME,
    "mean_profile",
    "profile_changes_per_min",
    "new_views_per_s",
)
PARTS = chosen(*(f"age_{part}_ms" for part in PART_TITLES))
PART_COLOURS = ("#bbbbbb", "#88ccee", "#0072b2", "#44aa99", "#d55e00", "#cc79a7", "#ddcc77")
MOST_NETWORKS = 8
"""Networks with figures of their own; tables and CSV files have all networks."""
OVERVIEW_NAMES = ("overview", "latency-parts", "quality-heatmap", "enhancement-heatmap", "rate-distortion")
"""File names of the figures over all networks."""


def drawn_networks(groups: Groups) -> list[str]:
    """The networks with figures of their own."""
    return groups.networks[:MOST_NETWORKS]


def figures(groups: Groups) -> Iterator[tuple[str | None, Plot]]:
    """All figures in the order of the page, each with its network (None: all networks)."""
    for draw in OVERVIEW_FIGURES:
        with style():
            plot = draw(groups)
        if plot is not None:
            yield None, plot
    for number, network in enumerate(drawn_networks(groups), 1):
        slug = f"{number:02}-" + (re.sub(r"[^A-Za-z0-9.-]+", "-", network).strip(".-")[:40] or "network")
        for draw_network in NETWORK_FIGURES:
            with style():
                plot = draw_network(groups, network)
            if plot is not None:
                yield network, replace(plot, name=f"{slug}_{plot.name}")


def overview(groups: Groups) -> Plot | None:
    """Latency, resolution, bandwidth and switches of each controller over each network."""
    columns = {name: groups.base(name) for name in groups.networks}
    metrics = _existing(OVERVIEW, groups)
    if not metrics:
        return None
    figure, panels = panel_grid(len(metrics))
    names = [short(name) for name in columns]
    for axes, metric in zip(panels, metrics, strict=True):
        draw_points(axes, columns, metric, groups.looks)
        axes.set_xticks(range(len(names)), names)
        if len(names) > MOST_COLUMNS:
            axes.tick_params(axis="x", labelrotation=40)
            for label in axes.get_xticklabels():
                label.set(horizontalalignment="right", rotation_mode="anchor")
    label_lowest(panels)
    every = [group for column in columns.values() for group in column]
    caption = f"Each controller over each network, {_lowest_rtts(groups)}. {_runs_behind(every)}"
    return finish(figure, panels, "overview", "Overview", caption)


def latency_parts(groups: Groups) -> Plot | None:
    """Parts of the mean frame age, stacked. None without server times."""
    own = [group for name in groups.networks for group in groups.base(name)]
    parts = {
        group: [spread.mean for metric in PARTS if (spread := group.spread(metric))]
        for group in own
        if group.spread(PARTS[0])
    }
    if not parts:
        return None
    figure = Figure(figsize=(WIDE * PANEL_IN, 0.9 + 0.32 * len(parts)), layout="constrained")
    axes = figure.subplots()
    left = np.zeros(len(parts))
    for title, colour, values in zip(
        PART_TITLES.values(), PART_COLOURS, zip(*parts.values(), strict=True), strict=True
    ):
        axes.barh(range(len(parts)), values, left=left, color=colour, label=title, height=0.7)
        left += np.array(values)
    one_network = len({group.condition.network for group in parts}) == 1
    labels = [
        group.controller.title if one_network else f"{group.controller.title}, {short(group.condition.network)}"
        for group in parts
    ]
    axes.set_yticks(range(len(parts)), labels)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set(xlabel="Mean frame age, ms (lower is better)", xlim=(0, None))
    caption = (
        f"Each controller over each network, {_lowest_rtts(groups)}. {_runs_behind(own)} Network includes both "
        "directions; the last part includes decoding and the wait for the display."
    )
    return finish(figure, [axes], "latency-parts", "Parts of the frame age", caption)


def quality_over_all(groups: Groups) -> Plot | None:
    """Quality against rate over all networks; None with fewer than two."""
    found = over_all(groups)
    return None if found is None else rate_distortion_plot(found, groups.looks, f"all networks, {_lowest_rtts(groups)}")


OVERVIEW_FIGURES = (overview, latency_parts, quality_heat_map, enhancement_heat_map, quality_over_all)


def over_rtt(groups: Groups, network: str) -> Plot | None:
    """Metrics over the round trip; None with fewer than two round trips."""
    rtts = groups.rtts(network)
    if len(rtts) < 2:
        return None
    own = [group for rtt in rtts for group in groups.at(network, rtt)]
    metrics = _existing(OVER_RTT, own)
    figure, panels = panel_grid(len(metrics))
    for axes, metric in zip(panels, metrics, strict=True):
        for controller, look in groups.looks.items():
            draw_line(axes, [group for group in own if group.controller == controller], metric, controller, look)
        metric_axis(axes, metric, extent(own, metric))
        axes.set_xlabel("Round trip, ms")
        axes.set_xticks(rtts, [f"{rtt:g}" for rtt in rtts])
    caption = f"Over {network}; bands and lines: {_runs_behind(own)}"
    return finish(figure, panels, "rtt", "Effect of the round trip", caption)


def latencies(groups: Groups, network: str) -> Plot | None:
    """Distribution of motion-to-photon latency over all inputs, one panel per round trip."""

    def draw(axes: Axes, panel: Sequence[Group], looks: Looks) -> list[float]:
        return draw_distributions(
            axes, ((group.controller.title, looks[group.controller], group.latencies) for group in panel)
        )

    caption = (
        "Cumulative distribution of motion-to-photon latency over all inputs of all runs. Unanswered inputs count, so "
        f"such a curve ends below 100 %. Dashed: {INTERACTIVE_MS:g} ms."
    )
    return _by_rtt(groups, network, "latency", "Motion-to-photon latency", caption, draw, horizontal=True)


def frame_ages(groups: Groups, network: str) -> Plot | None:
    """Distribution of frame ages at display time, one panel per round trip."""
    caption = (
        "Ages of all frames of all runs at display time: median, quartiles, and whiskers from the 5th to the 95th "
        f"percentile. Dashed: {INTERACTIVE_MS:g} ms."
    )
    return _by_rtt(groups, network, "frame-age", "Frame age", caption, draw_boxes)


def frame_ages_over_time(groups: Groups, network: str) -> Plot | None:
    """Age of each frame in the first run of each controller."""
    own = [group for group in groups.base(network) if len(group.runs[0].frame_ages)]
    if not own:
        return None
    figure, (axes,) = panel_grid(1, width=WIDE)
    drawn: list[float] = []
    for group in own:
        times, values = binned(*group.runs[0].frame_ages.T)
        axes.plot(times, values, linewidth=1, label=group.controller.title, **groups.looks[group.controller].line)
        drawn += values.tolist()
    interactive_limit(axes)
    plain_log(axes, drawn)
    axes.set(xlabel="Time, s", ylabel="Frame age, ms", xlim=(0, None))
    caption = (
        f"Over {_at_base(groups, network)}, first run of each controller; medians where frames are closer than "
        f"1/{BINS} of the run. Dashed: {INTERACTIVE_MS:g} ms."
    )
    return finish(figure, [axes], "frame-age-over-time", "Frame age over time", caption)


def heights_over_time(groups: Groups, network: str) -> Plot | None:
    """Resolution on the screen in the first run of each controller."""
    own = [group for group in groups.base(network) if len(group.runs[0].heights)]
    if not own:
        return None
    figure, (axes,) = panel_grid(1, width=WIDE)
    for group in own:
        run = group.runs[0]
        duration = run.record.configuration.duration_s
        during = run.heights[run.heights[:, 0] <= duration]
        changes = during[np.flatnonzero(np.diff(during[:, 1], prepend=0))]
        times, heights = (*changes[:, 0], duration), (*changes[:, 1], during[-1, 1])
        line = groups.looks[group.controller].line
        axes.step(times, heights, where="post", linewidth=1.2, label=group.controller.title, **line)
    axes.set(xlabel="Time, s", ylabel="Height, pixels", xlim=(0, None), ylim=(0, None))
    caption = f"Over {_at_base(groups, network)}, first run of each controller."
    return finish(figure, [axes], "height-over-time", "Height of the frame on the screen", caption)


def profiles(groups: Groups, network: str) -> Plot | None:
    """Share of time that each profile was on the screen."""
    own = [group for group in groups.base(network) if any(run.profile_shares for run in group.runs)]
    if not own:
        return None
    rungs = sorted({rung for group in own for run in group.runs for rung in run.profile_shares})
    figure = Figure(figsize=(WIDE * PANEL_IN, 0.7 + 0.32 * len(own)), layout="constrained")
    axes = figure.subplots()
    left = np.zeros(len(own))
    for rung in rungs:
        shares = [100 * sum(run.profile_shares.get(rung, 0.0) for run in g.runs) / len(g.runs) for g in own]
        shade = 0.25 + 0.6 * rung / max(1, rungs[-1])  # dark for the best profile
        colour = (0.15 + 0.75 * shade, 0.3 + 0.6 * shade, 0.5 + 0.42 * shade)
        axes.barh(range(len(own)), shares, left=left, color=colour, label=f"Profile {rung}", edgecolor=PAPER)
        left += np.array(shares)
    axes.set_yticks(range(len(own)), [group.controller.title for group in own])
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set(xlabel="Share of the time, %", xlim=(0, 100))
    caption = f"Over {_at_base(groups, network)}; 0 is the best profile. Means over the runs."
    return finish(figure, [axes], "profiles", "Profiles on the screen", caption)


def bandwidth(groups: Groups, network: str) -> Plot | None:
    """Received data over time, compared with downloading the scene's file at the link's full rate."""
    own = [group for group in groups.base(network) if any(len(run.received) > 1 for run in group.runs)]
    if not own:
        return None
    link = next((run.link for group in own for run in group.runs if len(run.link) > 1), None)
    size = next((run.record.scene_bytes for g in own for run in g.runs if run.record.scene_bytes), None)
    pictures = [group for group in own if len(group.runs[0].display_ssim)]
    figure, panels = panel_grid(3 if pictures else 2, width=1.2)
    rates, totals = panels[:2]
    for group in own:
        look = groups.looks[group.controller]
        every, mean, low, high = received(group)
        line: dict[str, Any] = {"label": group.controller.title, **look.line}
        rates.plot(every[1:], np.diff(mean) * 8 / np.diff(every), linewidth=1, **line)
        totals.plot(every, mean, linewidth=1.4, **line)
        if len(group.runs) > 1:
            totals.fill_between(every, low, high, color=look.colour, alpha=0.15, linewidth=0)
    if link is not None:
        _draw_download(rates, totals, link, size)
    for group in pictures:
        panels[2].plot(*group.runs[0].display_ssim.T, linewidth=1, **groups.looks[group.controller].line)
        panels[2].set(title="SSIM at display time, first run", xlabel="Time, s", xlim=(0, None), ylim=(0, 1))
    rates.set(title="Rate, Mbit/s", xlabel="Time, s", xlim=(0, None), ylim=(0, None))
    totals.set(title="Cumulative, MB", xlabel="Time, s", xlim=(0, None), ylim=(0, None))
    caption = (
        f"Data received by the viewer over {_at_base(groups, network)}. {_runs_behind(own)} Grey: the link at its full "
        "rate, as a download of the scene's file would use it."
    )
    return finish(figure, panels, "bandwidth", "Received data", caption)


def quality(groups: Groups, network: str) -> Plot | None:
    """Quality against rate; None without quality measurements."""
    found = RateDistortion.of(groups.base(network), network, groups.base_rtt(network))
    return None if found is None else rate_distortion_plot(found, groups.looks, _at_base(groups, network))


NETWORK_FIGURES = (
    over_rtt,
    latencies,
    frame_ages,
    frame_ages_over_time,
    heights_over_time,
    profiles,
    bandwidth,
    quality,
)


def write_headline(groups: Groups, folder: Path) -> None:
    """Latency distributions of the first networks and round trips, as headline.svg and headline.png. Raises OSError."""
    columns = [groups.at(network, rtt) for network, rtt in groups.conditions][:MOST_NETWORKS]
    with style():
        figure = Figure(figsize=(4.4 * len(columns), 3.1), layout="constrained")
        panels = figure.subplots(1, len(columns), squeeze=False, sharey=True)[0]
        for axes, own in zip(panels, columns, strict=True):
            curves = ((one.controller.title_with_mode, groups.looks[one.controller], one.latencies) for one in own)
            plain_log(axes, draw_distributions(axes, curves), horizontal=True)
            axes.set_title(own[0].runs[0].record.configuration.network.label, fontsize=9)
        for axes in panels[1:]:
            axes.set_ylabel("")
        add_legend(figure, panels)
        figure.savefig(folder / "headline.svg", metadata=NO_METADATA)
        figure.savefig(folder / "headline.png", dpi=160)


def _by_rtt(
    groups: Groups,
    network: str,
    name: str,
    title: str,
    caption: str,
    draw: Callable[[Axes, Sequence[Group], Looks], list[float]],
    *,
    horizontal: bool = False,
) -> Plot | None:
    """One panel per round trip, or a single one without known round trips, with a common time axis."""
    rtts: Sequence[float | None] = groups.rtts(network) or [None]
    by_rtt = {rtt: own for rtt in rtts if (own := groups.at(network, rtt))}
    if not any(len(group.latencies) for own in by_rtt.values() for group in own):
        return None
    present = {group.controller for own in by_rtt.values() for group in own}
    looks = {controller: look for controller, look in groups.looks.items() if controller in present}
    figure, panels = panel_grid(len(by_rtt), share=True)
    values: list[float] = []
    for panel, (rtt, own) in zip(panels, by_rtt.items(), strict=True):
        values += draw(panel, own, looks)
        panel.set_title(short(network) if rtt is None else f"{rtt:g} ms round trip")
    for place, panel in enumerate(panels):
        plain_log(panel, values, horizontal=horizontal)
        if place % MOST_COLUMNS:
            panel.tick_params(labelleft=False)
            panel.set_ylabel("")
    label_lowest(panels)
    return finish(figure, panels, name, title, f"Over {network}. {caption}")


def _draw_download(rates: Axes, totals: Axes, link: Floats, size: int | None) -> None:
    times, rate = link[:, 0], link[:, 1]
    thin = slice(None, None, max(1, len(times) // BINS))
    loaded = downloaded(link)
    area: dict[str, Any] = {"color": AREA, "linewidth": 0, "zorder": 0, "label": "Full link rate"}
    rates.fill_between(times[thin], rate[thin], step="post", **area)
    totals.fill_between(times[thin], loaded[thin], **area)
    if size is not None and loaded[-1] * 1e6 >= size:
        totals.axhline(size / 1e6, color=INK, linewidth=0.9, linestyle="--", label="Scene file")


def _runs_behind(groups: Sequence[Group]) -> str:
    """A sentence on the number of runs behind means and ranges."""
    counts = {len(group.runs) for group in groups}
    if counts == {1}:
        return "One run each." if len(groups) > 1 else "One run."
    low, high = min(counts), max(counts)
    configurations = [run.record.configuration for group in groups for run in group.runs]
    kinds = {
        "scenes": len({configuration.scene for configuration in configurations}),
        "movements": len({configuration.movement for configuration in configurations}),
    }
    several = [f"{number} {name}" for name, number in kinds.items() if number > 1]
    of = f" ({' and '.join(several)})" if several else ""
    return f"Means over {low if low == high else f'{low} to {high}'} runs{of}, with their range."


def _at_base(groups: Groups, network: str) -> str:
    rtt = groups.base_rtt(network)
    return network if rtt is None else f"{network} at {rtt:g} ms round trip"


def _lowest_rtts(groups: Groups) -> str:
    """The round trips of a figure over all networks."""
    found = sorted({rtt for name in groups.networks if (rtt := groups.base_rtt(name)) is not None})
    return f"at its lowest round trip ({', '.join(f'{rtt:g}' for rtt in found)} ms)" if found else "unchanged"


def _existing(metrics: Sequence[Metric], groups: Sequence[Group]) -> list[Metric]:
    return [metric for metric in metrics if any(group.spread(metric) for group in groups)]
