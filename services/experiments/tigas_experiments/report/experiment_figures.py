"""The figures of an experiment: one line, point or curve for each controller, drawn alike throughout.

A figure's title says what is seen in it; figures that the runs have nothing for are not drawn.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tigas_common.wire.figures import INTERACTIVE_MS
from tigas_experiments.report.captions import (
    against_download,
    at_base,
    at_lowest,
    best,
    change,
    each,
    short,
    spread_of,
    steadiness,
)
from tigas_experiments.report.charts import Looks, draw_boxes, draw_distributions, draw_line, draw_points
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.metrics import (
    FRAME_AGE_MEAN,
    HEIGHT,
    IN_TIME,
    NEW_VIEWS,
    PHOTON_P50,
    PHOTON_P95,
    PROFILE,
    RECEIVED,
    SWITCHES,
    Metric,
)
from tigas_experiments.report.motivation_figure import motivation
from tigas_experiments.report.picture_scores import rows_of
from tigas_experiments.report.plot import (
    AREA,
    INK,
    MOST_COLUMNS,
    PANEL_IN,
    PAPER,
    Plot,
    add_legend,
    extent,
    interactive_limit,
    label_lowest,
    metric_axis,
    panel_grid,
    plain_log,
    style,
    svg,
)
from tigas_experiments.report.quality_figures import heat_maps
from tigas_experiments.report.rate_distortion import RateDistortion, over_all
from tigas_experiments.report.rate_distortion_figure import rate_distortion
from tigas_experiments.report.results import Floats
from tigas_experiments.report.system_figure import system_panel
from tigas_experiments.report.time_series import BINS, binned, downloaded, received

WIDE = 2.6
"""How many times as wide a panel is that shows time."""
OVERVIEW = (PHOTON_P50, PHOTON_P95, IN_TIME, FRAME_AGE_MEAN, NEW_VIEWS, RECEIVED, HEIGHT, PROFILE, SWITCHES)
OVER_RTT = (FRAME_AGE_MEAN, PHOTON_P95, IN_TIME, PROFILE, SWITCHES, NEW_VIEWS)
MOST_NETWORKS = 8
"""So many are drawn one by one; the table and the CSV files have all."""


def figures(groups: Groups) -> Iterator[tuple[str | None, Plot]]:
    """All of them, in the order of the page, each with the network that it is of."""
    if (plot := overview(groups)) is not None:
        yield None, plot
    if (plot := motivation(groups)) is not None:
        yield None, plot
    if (plot := system_panel(groups)) is not None:
        yield None, plot
    for plot in heat_maps(rows_of(groups)):
        yield None, plot
    if (everywhere := over_all(groups)) is not None and (
        plot := rate_distortion(everywhere, groups.looks, f"all networks, {at_lowest(groups)}")
    ) is not None:
        yield None, plot
    for number, network in enumerate(groups.networks[:MOST_NETWORKS], 1):
        slug = f"{number:02}-" + (re.sub(r"[^A-Za-z0-9.-]+", "-", network).strip(".-")[:40] or "network")
        for draw in (over_rtt, latencies, frame_ages, frame_ages_over_time, profiles, bandwidth, quality):
            if (plot := draw(groups, network)) is not None:
                yield network, replace(plot, name=f"{slug}_{plot.name}")


def overview(groups: Groups) -> Plot | None:
    """Latency, resolution, bandwidth and switches of each controller, network by network."""
    columns = {name: groups.at(name, groups.base_rtt(name)) for name in groups.networks}
    metrics = _existing(OVERVIEW, groups)
    if not metrics:
        return None
    with style():
        figure, panels = panel_grid(len(metrics))
        for axes, metric in zip(panels, metrics, strict=True):
            draw_points(axes, columns, metric, groups.looks)
        names = [short(name) for name in columns]
        for axes in panels:
            axes.set_xticks(range(len(names)), names)
            if len(names) > MOST_COLUMNS:
                axes.tick_params(axis="x", labelrotation=40)
                for label in axes.get_xticklabels():
                    label.set(horizontalalignment="right", rotation_mode="anchor")
        label_lowest(panels)
        add_legend(figure, panels)
        every = [group for column in columns.values() for group in column]
        return Plot(
            "overview",
            best(every, IN_TIME),
            f"Each controller over each network, {at_lowest(groups)}. {spread_of(every)}",
            svg(figure),
        )


def over_rtt(groups: Groups, network: str) -> Plot | None:
    """What round trips do; None with fewer than two."""
    rtts = groups.rtts(network)
    if len(rtts) < 2:
        return None
    own = [group for rtt in rtts for group in groups.at(network, rtt)]
    metrics = _existing(OVER_RTT, own)
    with style():
        figure, panels = panel_grid(len(metrics))
        for axes, metric in zip(panels, metrics, strict=True):
            for controller, look in groups.looks.items():
                draw_line(axes, [group for group in own if group.controller == controller], metric, controller, look)
            metric_axis(axes, metric, extent(own, metric))
            axes.set_xlabel("Round trip, ms")
            axes.set_xticks(rtts, [f"{rtt:g}" for rtt in rtts])
        add_legend(figure, panels)
        title = change(own, rtts, FRAME_AGE_MEAN)
        return Plot("rtt", title, f"Over {network}; bands and lines: {spread_of(own)}", svg(figure))


def latencies(groups: Groups, network: str) -> Plot | None:
    """Distribution of motion-to-photon latency over all inputs, one panel for each round trip."""

    def draw(axes: Axes, panel: Sequence[Group], looks: Looks) -> list[float]:
        return draw_distributions(
            axes, ((group.controller.title, looks[group.controller], group.latencies) for group in panel)
        )

    return _by_rtt(
        groups,
        network,
        "latency",
        draw,
        lambda panel: f"Inputs on the screen within {INTERACTIVE_MS:g} ms: {each(panel, IN_TIME)}",
        "Cumulative distribution of motion-to-photon latency over all inputs of all runs; inputs that no frame "
        f"answered count, so that such a curve ends below 100 %. Dashed: {INTERACTIVE_MS:g} ms.",
        horizontal=True,
    )


def frame_ages(groups: Groups, network: str) -> Plot | None:
    """Distribution of the frames' ages when they came on the screen, one panel for each round trip."""
    return _by_rtt(
        groups,
        network,
        "frame-age",
        draw_boxes,
        lambda panel: f"Mean frame age: {each(panel, FRAME_AGE_MEAN)}",
        "Ages of all frames of all runs when they came on the screen: median, quartiles, and whiskers from the 5th to "
        f"the 95th percentile. Dashed: {INTERACTIVE_MS:g} ms.",
    )


def frame_ages_over_time(groups: Groups, network: str) -> Plot | None:
    """Age of frame after frame, in the first run of each controller."""
    own = [group for group in _base(groups, network) if len(group.runs[0].frame_ages)]
    if not own:
        return None
    with style():
        figure, (axes,) = panel_grid(1, width=WIDE)
        drawn: list[float] = []
        for group in own:
            times, values = binned(*group.runs[0].frame_ages.T)
            line = groups.looks[group.controller].line
            axes.plot(times, values, linewidth=1, label=group.controller.title, **line)
            drawn += values.tolist()
        interactive_limit(axes)
        plain_log(axes, drawn)
        axes.set(xlabel="Time, s", ylabel="Frame age, ms", xlim=(0, None))
        add_legend(figure, [axes])
        return Plot(
            "frame-age-over-time",
            steadiness(own),
            f"Age of each frame over {at_base(groups, network)} in the first run of each controller; the median "
            f"where frames are closer than 1/{BINS} of the run. Dashed: {INTERACTIVE_MS:g} ms.",
            svg(figure),
        )


def profiles(groups: Groups, network: str) -> Plot | None:
    """The share of time that each profile was on the screen."""
    own = [group for group in _base(groups, network) if any(run.figures.rungs.share for run in group.runs)]
    if not own:
        return None
    rungs = sorted({rung for group in own for run in group.runs for rung in run.figures.rungs.share})
    with style():
        figure = Figure(figsize=(WIDE * PANEL_IN, 0.7 + 0.32 * len(own)), layout="constrained")
        axes = figure.subplots()
        left = np.zeros(len(own))
        for rung in rungs:
            shares = [100 * sum(r.figures.rungs.share.get(rung, 0.0) for r in g.runs) / len(g.runs) for g in own]
            # From dark, the best, to light.
            shade = 0.25 + 0.6 * rung / max(1, rungs[-1])
            colour = (0.15 + 0.75 * shade, 0.3 + 0.6 * shade, 0.5 + 0.42 * shade)
            axes.barh(range(len(own)), shares, left=left, color=colour, label=f"Profile {rung}", edgecolor=PAPER)
            left += np.array(shares)
        axes.set_yticks(range(len(own)), [group.controller.title for group in own])
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set(xlabel="Share of the time, %", xlim=(0, 100))
        add_legend(figure, [axes])
        return Plot(
            "profiles",
            f"Mean profile on the screen: {each(own, PROFILE)}",
            f"Which profiles were on the screen over {at_base(groups, network)}; 0 is the best. Means over the runs.",
            svg(figure),
        )


def bandwidth(groups: Groups, network: str) -> Plot | None:
    """What is received over time, against downloading the scene's file at the link's full rate."""
    own = [group for group in _base(groups, network) if any(len(run.received) > 1 for run in group.runs)]
    if not own:
        return None
    link = next((run.link for group in own for run in group.runs if len(run.link) > 1), None)
    size = next((run.record.scene_bytes for g in own for run in g.runs if run.record.scene_bytes), None)
    with style():
        figure, (rates, totals) = panel_grid(2, width=1.4)
        for group in own:
            look = groups.looks[group.controller]
            every, mean, low, high = received(group)
            line: dict[str, Any] = {"label": group.controller.title, **look.line}
            rates.plot(every[1:], np.diff(mean) * 8 / np.diff(every), linewidth=1, **line)
            totals.plot(every, mean, linewidth=1.4, **line)
            if len(group.runs) > 1:
                totals.fill_between(every, low, high, color=look.colour, alpha=0.15, linewidth=0)
        if link is not None:
            _downloading(rates, totals, link, size)
        rates.set(title="Rate, Mbit/s", xlabel="Time, s", xlim=(0, None), ylim=(0, None))
        totals.set(title="Received by then, MB", xlabel="Time, s", xlim=(0, None), ylim=(0, None))
        add_legend(figure, [rates, totals])
        return Plot(
            "bandwidth",
            against_download(own, link, size),
            f"What the viewer received over {at_base(groups, network)}. {spread_of(own)} Grey: the link at its "
            "full rate, as a download of the scene's file would take it.",
            svg(figure),
        )


def quality(groups: Groups, network: str) -> Plot | None:
    """Quality against rate, if pictures were kept."""
    found = RateDistortion.of(_base(groups, network), network, groups.base_rtt(network))
    return None if found is None else rate_distortion(found, groups.looks, at_base(groups, network))


def _by_rtt(
    groups: Groups,
    network: str,
    name: str,
    draw: Callable[[Axes, Sequence[Group], Looks], list[float]],
    title: Callable[[list[Group]], str],
    caption: str,
    *,
    horizontal: bool = False,
) -> Plot | None:
    """One panel for each round trip, or one for the network as it is, with one axis of times for all."""
    rtts: Sequence[float | None] = groups.rtts(network) or [None]
    panels = {rtt: own for rtt in rtts if (own := groups.at(network, rtt))}
    if not any(len(group.latencies) for own in panels.values() for group in own):
        return None
    present = {group.controller for own in panels.values() for group in own}
    looks = {controller: look for controller, look in groups.looks.items() if controller in present}
    with style():
        figure, axes = panel_grid(len(panels), share=True)
        values: list[float] = []
        for panel, (rtt, own) in zip(axes, panels.items(), strict=True):
            values += draw(panel, own, looks)
            panel.set_title(short(network) if rtt is None else f"{rtt:g} ms round trip")
        for place, panel in enumerate(axes):
            plain_log(panel, values, horizontal=horizontal)
            if place % MOST_COLUMNS:
                panel.tick_params(labelleft=False)
                panel.set_ylabel("")
        label_lowest(axes)
        add_legend(figure, axes)
        first, own = next(iter(panels.items()))
        at = "" if first is None else f" ({first:g} ms round trip)"
        return Plot(name, f"{title(own)}{at}", f"Over {network}. {caption}", svg(figure))


def _downloading(rates: Axes, totals: Axes, link: Floats, size: int | None) -> None:
    times, rate = link[:, 0], link[:, 1]
    thin = slice(None, None, max(1, len(times) // BINS))
    loaded = downloaded(link)
    area: dict[str, Any] = {"color": AREA, "linewidth": 0, "zorder": 0, "label": "Link's full rate"}
    rates.fill_between(times[thin], rate[thin], step="post", **area)
    totals.fill_between(times[thin], loaded[thin], **area)
    if size is not None and loaded[-1] * 1e6 >= size:
        totals.axhline(size / 1e6, color=INK, linewidth=0.9, linestyle="--", label="Scene's file")


def _base(groups: Groups, network: str) -> list[Group]:
    return groups.at(network, groups.base_rtt(network))


def _existing(metrics: Sequence[Metric], groups: Sequence[Group]) -> list[Metric]:
    return [metric for metric in metrics if any(group.spread(metric) for group in groups)]
