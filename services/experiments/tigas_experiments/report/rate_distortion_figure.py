"""The figure of quality against rate: a curve through fixed rungs, a point for whatever adapts."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from tigas_experiments.report.blocks import Estimate, signed
from tigas_experiments.report.charts import Looks
from tigas_experiments.report.metrics import PICTURE_SSIM, RECEIVED, SEEN_SSIM, Metric
from tigas_experiments.report.plot import Plot, add_legend, label_lowest, panel_grid, style, svg
from tigas_experiments.report.rate_distortion import QUALITIES, EqualRate, RateDistortion, Series

RATE_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
MOST_COMPARED = 4
"""In a title."""
NO_CURVE = "No curve: without two fixed rungs or representations, qualities at unlike rates cannot be compared"


def rate_distortion(found: RateDistortion, looks: Looks, where: str) -> Plot | None:
    """Of one network, or of all. None if no panel would have a point."""
    metrics = [
        metric
        for metric in QUALITIES
        if any(series.mean(controller, metric) for series in found.series for controller in series.controllers)
    ]
    if not metrics:
        return None
    with style():
        figure, panels = panel_grid(len(metrics), columns=2)
        for axes, metric in zip(panels, metrics, strict=True):
            for series in found.series:
                _draw(axes, series, metric, looks)
            axes.set_title(f"{metric.heading} (higher is better)")
            _rate_axis(axes, found)
        label_lowest(panels, columns=2)
        add_legend(figure, panels)
        return Plot(
            "rate-distortion",
            _title(found.equal_rates),
            f"Quality against what the page received, over {where}. Small points: blocks; large: their means, with "
            "95 % confidence intervals from six blocks on. Lines: through the fixed rungs of a mode.",
            svg(figure),
        )


def _title(compared: Sequence[EqualRate]) -> str:
    """What the first curve is compared with."""
    if not compared:
        return NO_CURVE
    curve = compared[0].curve
    against = [one for one in compared if one.curve is curve]
    seen = any(SEEN_SSIM in sample for samples in curve.samples.values() for sample in samples.values())
    metric = SEEN_SSIM if seen else PICTURE_SSIM
    found = {one.other.title: one.differences.get(metric) for one in against[:MOST_COMPARED]}
    told = [f"{title} {signed(metric, one.mean) if one else 'shares no rate'}" for title, one in found.items()]
    more = ["more in the table"] if len(against) > MOST_COMPARED else []
    return f"{metric.title} at equal rates, less that of {curve.title}: {'; '.join(told + more)}"


def _draw(axes: Axes, series: Series, metric: Metric, looks: Looks) -> None:
    colour = looks[series.controllers[0]].colour
    means: list[tuple[float, float]] = []
    for controller in series.controllers:
        blocks = [sample for sample in series.samples[controller].values() if metric in sample]
        rate, quality = (Estimate.over([sample[each] for sample in blocks]) for each in (RECEIVED, metric))
        if rate is None or quality is None:
            continue
        if len(blocks) > 1:
            axes.plot(
                [sample[RECEIVED] for sample in blocks],
                [sample[metric] for sample in blocks],
                ".",
                color=colour,
                markersize=3,
                alpha=0.35,
            )
        axes.errorbar(
            [rate.mean],
            [quality.mean],
            xerr=_whiskers(rate),
            yerr=_whiskers(quality),
            fmt=looks[controller].marker,
            color=colour,
            markersize=6,
            elinewidth=1.2,
            label=controller.title,
        )
        means.append((rate.mean, quality.mean))
    if series.is_curve and means:
        axes.plot(*zip(*sorted(means), strict=True), color=colour, linewidth=1.2, zorder=1)


def _whiskers(estimate: Estimate) -> tuple[list[float], list[float]] | None:
    if estimate.interval is None:
        return None
    low, high = estimate.interval
    return [max(0.0, estimate.mean - low)], [max(0.0, high - estimate.mean)]


def _rate_axis(axes: Axes, found: RateDistortion) -> None:
    rates = [sample[RECEIVED] for series in found.series for own in series.samples.values() for sample in own.values()]
    low, high = min(rates) / 1.3, max(rates) * 1.3
    ticks = [tick for tick in RATE_TICKS if low <= tick <= high]
    axes.set_xscale("log")
    axes.xaxis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.xaxis.set_ticks([], minor=True)
    axes.set(xlabel=RECEIVED.heading, xlim=(low, high))
