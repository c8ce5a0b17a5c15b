"""The charts of a panel: points with whiskers, lines in bands, cumulative distributions, boxes, and time series."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from tigas_experiments.report.controllers import Controller, Look
from tigas_experiments.report.groups import Group, Spread
from tigas_experiments.report.metrics import Metric
from tigas_experiments.report.plot import INK, extent, interactive_limit, metric_axis
from tigas_experiments.report.results import Floats

Looks = Mapping[Controller, Look]
DISTRIBUTION_POINTS = 200
"""Maximum points of a drawn distribution."""
BINS = 240
"""Maximum points of a time series."""


def draw_points(axes: Axes, columns: Mapping[str, Sequence[Group]], metric: Metric, looks: Looks) -> None:
    """Means with whiskers to the lowest and highest run, one column per network."""
    width = 0.7 / max(1, len(looks))
    for place, (controller, look) in enumerate(looks.items()):
        offset = (place - (len(looks) - 1) / 2) * width
        every = [
            (column + offset, spread)
            for column, groups in enumerate(columns.values())
            for group in groups
            if group.controller == controller and (spread := group.spread(metric))
        ]
        _draw_infinite(axes, every, look)
        spreads = [(x, spread) for x, spread in every if math.isfinite(spread.high)]
        if not spreads:
            continue
        axes.errorbar(
            [x for x, _ in spreads],
            [spread.mean for _, spread in spreads],
            yerr=([s.mean - s.low for _, s in spreads], [s.high - s.mean for _, s in spreads]),
            fmt=look.marker,
            color=look.colour,
            markersize=5,
            elinewidth=1.2,
            label=controller.title,
        )
    metric_axis(axes, metric, extent([group for groups in columns.values() for group in groups], metric))
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.grid(visible=False, axis="x")


def draw_line(axes: Axes, groups: Sequence[Group], metric: Metric, controller: Controller, look: Look) -> None:
    """Means of one controller over the round trip, in a band from the lowest to the highest run."""
    every = [(group.condition.rtt_ms or 0.0, spread) for group in groups if (spread := group.spread(metric))]
    _draw_infinite(axes, every, look)
    found = [(rtt, spread) for rtt, spread in every if math.isfinite(spread.high)]
    if not found:
        return
    rtts, means = [rtt for rtt, _ in found], [spread.mean for _, spread in found]
    axes.plot(rtts, means, marker=look.marker, markersize=4, linewidth=1.4, label=controller.title, **look.line)
    if any(spread.runs > 1 for _, spread in found):
        lows, highs = [spread.low for _, spread in found], [spread.high for _, spread in found]
        axes.fill_between(rtts, lows, highs, color=look.colour, alpha=0.15, linewidth=0)


def _draw_infinite(axes: Axes, spreads: Sequence[tuple[float, Spread]], look: Look) -> None:
    """A hollow marker at the upper edge where too many inputs of a run were never answered."""
    at = [x for x, spread in spreads if not math.isfinite(spread.high)]
    if at:
        edge = axes.get_xaxis_transform()
        axes.plot(at, [1.0] * len(at), look.marker, transform=edge, color=look.colour, mfc="none", clip_on=False)


def draw_distributions(axes: Axes, curves: Iterable[tuple[str, Look, Floats]]) -> list[float]:
    """Distributions of motion-to-photon latency (ms) by label and look; returns times that the axis must cover."""
    every: list[float] = []
    for label, look, latencies in curves:
        values, shares = distribution(latencies)
        if len(values):
            axes.step(values, 100 * shares, where="post", linewidth=1.5, label=label, **look.line)
            every += np.quantile(values, (0, 0.995)).tolist()  # outliers may exceed the axis
    interactive_limit(axes, horizontal=True)
    axes.set(xlabel="Motion-to-photon latency, ms", ylabel="Inputs, %", ylim=(0, 101))
    return every


def draw_boxes(axes: Axes, groups: Sequence[Group], looks: Looks) -> list[float]:
    """Box plots of frame ages; returns times (ms) that the axis must cover."""
    whiskers: list[float] = []
    places = {controller: place for place, controller in enumerate(looks)}  # equal in all panels
    for group in groups:
        values = group.frame_ages
        if not len(values):
            continue
        low, q1, middle, q3, high = np.percentile(values, (5, 25, 50, 75, 95)).tolist()
        colour = looks[group.controller].colour
        axes.bxp(
            [{"whislo": low, "q1": q1, "med": middle, "q3": q3, "whishi": high}],
            positions=[places[group.controller]],
            widths=0.6,
            showfliers=False,
            patch_artist=True,
            boxprops={"facecolor": colour, "edgecolor": colour, "alpha": 0.75},
            medianprops={"color": INK, "linewidth": 1.5},
            whiskerprops={"color": colour},
            capprops={"color": colour},
        )
        whiskers += [low, high]
    interactive_limit(axes)
    axes.set_xticks(range(len(looks)), [controller.title for controller in looks], rotation=20, ha="right")
    axes.set_ylabel("Frame age, ms")
    return whiskers


def distribution(values: Floats) -> tuple[Floats, Floats]:
    """Steps of the cumulative distribution: finite values, and the share of all values up to each."""
    finite = np.sort(values[np.isfinite(values)])
    kept = np.unique(np.linspace(0, len(finite) - 1, min(len(finite), DISTRIBUTION_POINTS)).round().astype(int))
    return finite[kept], (kept + 1) / len(values)


def downloaded(link: Floats) -> Floats:
    """Megabytes that the link could have carried by each sample."""
    spans = np.diff(link[:, 0], prepend=0.0).clip(min=0)
    total: Floats = np.cumsum(spans * link[:, 1]) / 8
    return total


def received(group: Group) -> tuple[Floats, Floats, Floats, Floats]:
    """Seconds, and mean, lowest and highest megabytes received by then, up to the end of the shortest run."""
    runs = [run.received for run in group.runs if len(run.received) > 1]
    end = min(float(received[-1, 0]) for received in runs)
    steps = min(BINS, min(len(received) for received in runs))  # at most the page's own resolution
    every = np.linspace(0, end, max(2, steps))
    totals = np.array([np.interp(every, r[:, 0], (r[:, 1] - r[0, 1]) / 1e6) for r in runs])
    return every, totals.mean(axis=0), totals.min(axis=0), totals.max(axis=0)


def binned(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Medians over BINS parts of the time; unchanged if there are fewer values."""
    if len(times) <= BINS:
        return times, values
    place = np.linspace(times[0], times[-1], BINS + 1).searchsorted(times, side="right")
    kept = np.unique(place)
    return (
        np.array([times[place == each].mean() for each in kept]),
        np.array([np.median(values[place == each]) for each in kept]),
    )
