"""What is drawn in a panel for each controller: points, lines, distributions and boxes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from tigas_experiments.report.drawing import INK, distribution, interactive_limit
from tigas_experiments.report.metrics import Metric
from tigas_experiments.report.panels import extent, metric_axis
from tigas_experiments.report.results import Group, Spread
from tigas_experiments.report.variants import Look, Variant

Looks = Mapping[Variant, Look]


def draw_points(axes: Axes, columns: Mapping[str, Sequence[Group]], metric: Metric, looks: Looks) -> None:
    """Means, with the least and the greatest, network by network."""
    width = 0.7 / max(1, len(looks))
    for place, (variant, look) in enumerate(looks.items()):
        offset = (place - (len(looks) - 1) / 2) * width
        every = [
            (column + offset, spread)
            for column, groups in enumerate(columns.values())
            for group in groups
            if group.variant == variant and (spread := group.spread(metric))
        ]
        _draw_never(axes, every, look)
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
            label=variant.title,
        )
    metric_axis(axes, metric, extent([group for groups in columns.values() for group in groups], metric))
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.grid(visible=False, axis="x")


def draw_line(axes: Axes, groups: Sequence[Group], metric: Metric, variant: Variant, look: Look) -> None:
    """Means of one variant over the round trip, in a band from the least to the greatest."""
    every = [(group.condition.rtt_ms or 0.0, spread) for group in groups if (spread := group.spread(metric))]
    _draw_never(axes, every, look)
    found = [(rtt, spread) for rtt, spread in every if math.isfinite(spread.high)]
    if not found:
        return
    rtts = [rtt for rtt, _ in found]
    axes.plot(
        rtts,
        [spread.mean for _, spread in found],
        marker=look.marker,
        markersize=4,
        linewidth=1.4,
        label=variant.title,
        **look.line,
    )
    if any(spread.runs > 1 for _, spread in found):
        lows, highs = [spread.low for _, spread in found], [spread.high for _, spread in found]
        axes.fill_between(rtts, lows, highs, color=look.colour, alpha=0.15, linewidth=0)


def _draw_never(axes: Axes, spreads: Sequence[tuple[float, Spread]], look: Look) -> None:
    """Hollow, at the upper edge: what has no mean, since too many inputs were never answered in one of its runs."""
    at = [x for x, spread in spreads if not math.isfinite(spread.high)]
    if not at:
        return
    edge = axes.get_xaxis_transform()
    axes.plot(at, [1.0] * len(at), look.marker, transform=edge, color=look.colour, mfc="none", clip_on=False)


def draw_distributions(axes: Axes, groups: Sequence[Group], looks: Looks) -> list[float]:
    """Of motion-to-photon latency; returns the times (ms) that the axis has to reach over."""
    every: list[float] = []
    for group in groups:
        look = looks[group.variant]
        values, shares = distribution(group.latencies.tolist())
        if values:
            axes.step(
                values,
                [100 * share for share in shares],
                where="post",
                linewidth=1.5,
                label=group.variant.title,
                **look.line,
            )
            # The last few, which may be very late, need not be seen.
            every += np.quantile(values, (0, 0.995)).tolist()
    interactive_limit(axes, horizontal=True)
    axes.set(xlabel="Motion-to-photon latency, ms", ylabel="Inputs, %", ylim=(0, 101))
    return every


def draw_boxes(axes: Axes, groups: Sequence[Group], looks: Looks) -> list[float]:
    """Of response times; returns the times (ms) that the axis has to reach over."""
    whiskers: list[float] = []
    places = {variant: place for place, variant in enumerate(looks)}  # in every panel, although one may lack some
    for group in groups:
        values = group.responses
        if not len(values):
            continue
        low, q1, middle, q3, high = np.percentile(values, (5, 25, 50, 75, 95)).tolist()
        box = {"whislo": low, "q1": q1, "med": middle, "q3": q3, "whishi": high}
        colour = looks[group.variant].colour
        axes.bxp(
            [box],
            positions=[places[group.variant]],
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
    axes.set_xticks(range(len(looks)), [variant.title for variant in looks], rotation=20, ha="right")
    axes.set_ylabel("Response, ms")
    return whiskers
