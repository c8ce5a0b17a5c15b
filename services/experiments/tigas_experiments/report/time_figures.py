"""Figures of times and over time: latency, frame age, resolution, and received data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binned_statistic

from tigas_experiments.report.controllers import Controller, LineLook
from tigas_experiments.report.groups import Group, Groups, describe_run_counts
from tigas_experiments.report.plot import (
    AREA,
    INK,
    MOST_COLUMNS,
    NO_METADATA,
    PANEL_IN,
    WIDE_IN,
    Plot,
    add_legend,
    interactive_limit,
    label_lowest,
    panel_grid,
    plain_log,
    plot_style,
    shorten,
)
from tigas_experiments.report.run_table import Floats, Run
from tigas_experiments.wire.figures import INTERACTIVE_MS

Looks = Mapping[Controller, LineLook]
DISTRIBUTION_POINTS = 200
"""Maximum number of points in a drawn distribution."""
BINS = 240
"""Maximum number of points in a time series."""
MOST_HEADLINES = 8
"""Maximum number of panels in the headline figure."""
DASHED = f"Dashed: {INTERACTIVE_MS:g} ms."


def latencies(groups: Groups, network: str) -> Plot | None:
    """Distribution of motion-to-photon latency over all inputs, one panel per round trip."""
    caption = (
        f"Over {network}. Cumulative distribution of motion-to-photon latency over all inputs of all runs. Unanswered "
        f"inputs count, so such a curve ends below 100 %. {DASHED}"
    )
    drawn = _panels(groups, _by_rtt(groups, network), _draw_distributions, horizontal=True)
    return drawn and Plot.from_figure(*drawn, "latency", "Motion-to-photon latency", caption)


def frame_ages(groups: Groups, network: str) -> Plot | None:
    """Distribution of frame ages at display time, one panel per round trip."""
    caption = (
        f"Over {network}. Ages of all frames of all runs at display time: median, quartiles, and whiskers from the 5th "
        f"to the 95th percentile. {DASHED}"
    )
    drawn = _panels(groups, _by_rtt(groups, network), draw_boxes)
    return drawn and Plot.from_figure(*drawn, "frame-age", "Frame age", caption)


def write_headline(groups: Groups, folder: Path) -> None:
    """Latency distributions of the first networks and round trips, as headline.svg and headline.png. Raises OSError."""
    found = (groups.at(network, rtt) for network, rtt in groups.conditions[:MOST_HEADLINES])
    panels_of = {own[0].runs[0].configuration.network.label: own for own in found}
    draw = partial(_draw_distributions, with_mode=True)
    with plot_style():
        drawn = _panels(groups, panels_of, draw, horizontal=True, columns=MOST_HEADLINES)
        if drawn:
            add_legend(*drawn)
            drawn[0].savefig(folder / "headline.svg", metadata=NO_METADATA)
            drawn[0].savefig(folder / "headline.png", dpi=160)


def _by_rtt(groups: Groups, network: str) -> dict[str, list[Group]]:
    rtts = groups.rtts(network)
    return {f"{rtt:g} ms round trip": groups.at(network, rtt) for rtt in rtts} or {
        shorten(network): groups.at(network, None)
    }


def _panels(
    groups: Groups,
    panels_of: Mapping[str, Sequence[Group]],
    draw: Callable[[Axes, Sequence[Group], Looks], list[float]],
    *,
    horizontal: bool = False,
    columns: int = MOST_COLUMNS,
) -> tuple[Figure, list[Axes]] | None:
    """Panels by title with a common time axis, which covers the values returned by `draw`; None without values."""
    present = {group.controller for own in panels_of.values() for group in own}
    looks = {controller: look for controller, look in groups.looks.items() if controller in present}
    figure, panels = panel_grid(len(panels_of), share=True, columns=columns)
    values: list[float] = []
    for axes, (title, own) in zip(panels, panels_of.items(), strict=True):
        values += draw(axes, own, looks)
        axes.set_title(title)
    for place, axes in enumerate(panels):
        plain_log(axes, values, horizontal=horizontal)
        if place % columns:
            axes.tick_params(labelleft=False)
            axes.set_ylabel("")
    label_lowest(panels, columns=columns)
    return (figure, panels) if values else None


def _draw_distributions(axes: Axes, groups: Sequence[Group], looks: Looks, *, with_mode: bool = False) -> list[float]:
    every: list[float] = []
    for group in groups:
        controller = group.controller
        values, shares = distribution(group.pooled("latency"))
        if len(values):
            label = controller.title_with_mode if with_mode else controller.title
            axes.step(values, 100 * shares, where="post", linewidth=1.5, label=label, **looks[controller].line)
            every += np.quantile(values, (0, 0.995)).tolist()  # outliers may exceed the axis
    interactive_limit(axes, horizontal=True)
    axes.set(xlabel="Motion-to-photon latency, ms", ylabel="Inputs, %", ylim=(0, 101))
    return every


def draw_boxes(axes: Axes, groups: Sequence[Group], looks: Looks) -> list[float]:
    """Draw box plots of frame ages; returns the ends of the whiskers."""
    whiskers: list[float] = []
    places = list(looks)  # the same in all panels
    for group in groups:
        values = group.pooled("age")
        if not len(values):
            continue
        colour = looks[group.controller].colour
        axes.boxplot(
            values,
            positions=[places.index(group.controller)],
            widths=0.6,
            whis=(5, 95),
            showfliers=False,
            patch_artist=True,
            boxprops={"facecolor": colour, "edgecolor": colour, "alpha": 0.75},
            medianprops={"color": INK, "linewidth": 1.5},
            whiskerprops={"color": colour},
            capprops={"color": colour},
        )
        whiskers += np.percentile(values, (5, 95)).tolist()
    interactive_limit(axes)
    slant: dict[str, Any] = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}
    axes.set_xticks(range(len(places)), [shorten(controller.title) for controller in places], **slant)
    axes.set_ylabel("Frame age, ms")
    return whiskers


def distribution(values: Floats) -> tuple[Floats, Floats]:
    """Steps of the cumulative distribution: finite values, and the share of all values up to each."""
    finite = np.sort(values[np.isfinite(values)])
    kept = np.unique(np.linspace(0, len(finite) - 1, min(len(finite), DISTRIBUTION_POINTS)).round().astype(int))
    return finite[kept], (kept + 1) / len(values)


def frame_ages_over_time(groups: Groups, network: str) -> Plot | None:
    """Age of each frame in the first run of each controller."""
    return _over_time(groups, network, "age", "Frame age over time", "Frame age, ms")


def heights_over_time(groups: Groups, network: str) -> Plot | None:
    """Resolution on screen in the first run of each controller."""
    return _over_time(groups, network, "height", "Height of the frame on the screen", "Height, pixels")


def _over_time(groups: Groups, network: str, series: Literal["age", "height"], title: str, label: str) -> Plot | None:
    own = {group: group.runs[0].series[series] for group in groups.base(network)}
    own = {group: points for group, points in own.items() if len(points)}
    if not own:
        return None
    figure, (axes,) = panel_grid(1, width=WIDE_IN)
    axes.set(xlabel="Time, s", ylabel=label)
    drawn: list[float] = []
    for group, points in own.items():
        times, values = bin_medians(*points.T)
        line: dict[str, Any] = {"label": group.controller.title, **groups.looks[group.controller].line}
        axes.plot(times, values, linewidth=1.2, drawstyle="default" if series == "age" else "steps-post", **line)
        drawn += values.tolist()
    axes.set(xlim=(0, None), ylim=(0, None))
    if series == "age":
        interactive_limit(axes)
        plain_log(axes, drawn)
    caption = (
        f"Over {groups.base_title(network)}, first run of each controller; medians where frames are closer than "
        f"1/{BINS} of the run. {DASHED if series == 'age' else ''}".rstrip()
    )
    name = "frame-age" if series == "age" else series
    return Plot.from_figure(figure, [axes], f"{name}-over-time", title, caption)


def bandwidth(groups: Groups, network: str) -> Plot | None:
    """Received data over time, compared with downloading the scene's file at the link's full rate."""
    own = [group for group in groups.base(network) if any(len(run.series["received"]) > 1 for run in group.runs)]
    if not own:
        return None
    pictures = [group for group in own if len(group.runs[0].series["ssim"])]
    figure, panels = panel_grid(3 if pictures else 2, width=1.2 * PANEL_IN)
    rates, totals = panels[:2]
    for group in own:
        look = groups.looks[group.controller]
        times, megabytes = received_megabytes(group)
        line: dict[str, Any] = {"label": group.controller.title, **look.line}
        mean = megabytes.mean(axis=0)
        rates.plot(times[1:], np.diff(mean) * 8 / np.diff(times), linewidth=1, **line)
        totals.plot(times, mean, linewidth=1.4, **line)
        if len(group.runs) > 1:
            low, high = megabytes.min(axis=0), megabytes.max(axis=0)
            totals.fill_between(times, low, high, color=look.colour, alpha=0.15, linewidth=0)
    _draw_download(rates, totals, [run for group in own for run in group.runs])
    for group in pictures:
        panels[2].plot(*group.runs[0].series["ssim"].T, linewidth=1, **groups.looks[group.controller].line)
        panels[2].set(title="SSIM at display time, first run", ylim=(0, 1))
    rates.set(title="Rate, Mbit/s", ylim=(0, None))
    totals.set(title="Cumulative, MB", ylim=(0, None))
    for axes in panels:
        axes.set(xlabel="Time, s", xlim=(0, None))
    caption = (
        f"Data received by the viewer over {groups.base_title(network)}. {describe_run_counts(own)} Grey: the link at "
        "its full rate, as a download of the scene's file would use it."
    )
    return Plot.from_figure(figure, panels, "bandwidth", "Received data", caption)


def _draw_download(rates: Axes, totals: Axes, runs: Sequence[Run]) -> None:
    """Draw the full rate of the first known link, and the size of the scene's file if it could have been downloaded."""
    link = next((run.series["link"] for run in runs if len(run.series["link"]) > 1), None)
    if link is None:
        return
    size = next((run.record.scene_bytes for run in runs if run.record.scene_bytes), None)
    thin = slice(None, None, max(1, len(link) // BINS))
    loaded = downloadable_megabytes(link)
    area: dict[str, Any] = {"color": AREA, "linewidth": 0, "zorder": 0, "label": "Full link rate"}
    rates.fill_between(link[thin, 0], link[thin, 1], step="post", **area)
    totals.fill_between(link[thin, 0], loaded[thin], **area)
    if size is not None and loaded[-1] * 1e6 >= size:
        totals.axhline(size / 1e6, color=INK, linewidth=0.9, linestyle="--", label="Scene file")


def downloadable_megabytes(link: Floats) -> Floats:
    """Megabytes that the link could have carried up to each sample."""
    spans = np.diff(link[:, 0], prepend=0.0).clip(min=0)
    total: Floats = np.cumsum(spans * link[:, 1]) / 8
    return total


def received_megabytes(group: Group) -> tuple[Floats, Floats]:
    """Seconds, and megabytes [runs, seconds] received by then, up to the end of the shortest run."""
    runs = [run.series["received"] for run in group.runs if len(run.series["received"]) > 1]
    steps = min(BINS, min(len(run) for run in runs))  # at most the page's own resolution
    every = np.linspace(0, min(float(run[-1, 0]) for run in runs), max(2, steps))
    return every, np.array([np.interp(every, run[:, 0], (run[:, 1] - run[0, 1]) / 1e6) for run in runs])


def bin_medians(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Medians over BINS parts of the time; unchanged if there are fewer values."""
    if len(times) <= BINS:
        return times, values
    medians, edges, _ = binned_statistic(times, values, "median", BINS)
    known = np.isfinite(medians)
    return (edges[:-1] + edges[1:])[known] / 2, medians[known]
