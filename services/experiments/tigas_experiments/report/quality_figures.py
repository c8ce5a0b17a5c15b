"""Figures of picture quality: heat maps of sampled pictures' scores, and quality against rate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from tigas_experiments.quality.metrics import PictureMetric
from tigas_experiments.report.charts import Looks
from tigas_experiments.report.controllers import in_order
from tigas_experiments.report.estimates import Estimate
from tigas_experiments.report.groups import Condition, Groups
from tigas_experiments.report.metrics import Metric
from tigas_experiments.report.picture_scores import PictureKind, Row, computed, rows_of
from tigas_experiments.report.plot import PAPER, Plot, finish, label_lowest, panel_grid, short
from tigas_experiments.report.rate_distortion import QUALITIES, RECEIVED, RateDistortion, Series

COLUMNS = 3
CELL_IN, LABELS_IN = (1.05, 0.5), (1.4, 0.75)
"""Width and height of a cell, and of the labels, inches."""
Line = tuple[str, float | None, str | None]
"""A row of a heat map: network, round trip, and model of a difference."""
DARK, LIGHT = "#101418", "#fdfdfd"
"""Text colours in a cell, which do not change on a dark page."""
RATE_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)


def quality_heat_map(groups: Groups) -> Plot | None:
    """Scores of the original frames."""
    return _heat_map(groups, "original", "quality-heatmap", "Quality of the frames", "Frames enlarged by bicubic")


def enhancement_heat_map(groups: Groups) -> Plot | None:
    """Differences between the scores of enhanced and original frames."""
    caption = "Enhanced pictures minus the originals, per sample. Blue is better, red is worse"
    return _heat_map(groups, "difference", "enhancement-heatmap", "Effect of enhancement", caption)


def _heat_map(groups: Groups, kind: PictureKind, name: str, title: str, caption: str) -> Plot | None:
    rows = [row for row in rows_of(groups) if row.kind == kind]
    metrics = computed(rows)
    if not metrics:
        return None
    lines = list(dict.fromkeys(_line(row) for row in rows))
    controllers = in_order(_condition(row).controller for row in rows)
    grid_rows, columns = math.ceil(len(metrics) / COLUMNS), min(len(metrics), COLUMNS)
    width = LABELS_IN[0] + CELL_IN[0] * len(controllers)
    height = LABELS_IN[1] + CELL_IN[1] * len(lines)
    figure = Figure(figsize=(width * columns, height * grid_rows), layout="constrained")
    panels = figure.subplots(grid_rows, columns, squeeze=False).flatten().tolist()
    for spare in panels[len(metrics) :]:
        spare.remove()
    cells = {(_line(row), _condition(row).controller): row for row in rows}
    grid = [[cells.get((line, controller)) for controller in controllers] for line in lines]
    for axes, metric in zip(panels, metrics, strict=False):
        _draw_cells(axes, metric, grid, signed=kind == "difference")
        axes.set_xticks([0.5 + x for x in range(len(controllers))], [short(one.title) for one in controllers])
        axes.set_yticks([0.5 + y for y in range(len(lines))], [_label(line) for line in lines])
    pictures = [mean.pictures for row in rows for metric in metrics if (mean := row.mean(metric)) is not None]
    low, high = min(pictures), max(pictures)
    counted = f"{low:,}" if low == high else f"{low:,} to {high:,}"
    variants = "; ".join(f"{metric.title}: {metric.variant}" for metric in metrics)
    caption = f"{caption}; mean ± standard deviation over {counted} sampled pictures. {variants}."
    return finish(figure, panels[: len(metrics)], name, title, caption)


def _draw_cells(axes: Axes, metric: PictureMetric, grid: Sequence[Sequence[Row | None]], *, signed: bool) -> None:
    means = [[None if row is None else row.mean(metric) for row in line] for line in grid]
    values = [[math.nan if mean is None else mean.mean for mean in line] for line in means]
    known = [value for line in values for value in line if not math.isnan(value)]
    if signed:
        largest = max(map(abs, known)) or 1.0
        norm, colours = Normalize(-largest, largest), "RdBu"
    else:
        norm, colours = Normalize(min(known), max(known)), "cividis"
    if metric.better == "low":
        colours += "_r"
    colour_map = mpl.colormaps[colours]
    axes.pcolormesh(values, cmap=colour_map, norm=norm, edgecolors=PAPER, linewidth=1.5)
    for y, line in enumerate(means):
        for x, mean in enumerate(line):
            if mean is not None:
                red, green, blue, _ = colour_map(0.5 if norm.vmin == norm.vmax else float(norm(mean.mean)))
                text = mean.text(metric, signed=signed).replace(" ± ", "\n± ")
                ink = DARK if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else LIGHT
                axes.text(x + 0.5, y + 0.5, text, ha="center", va="center", fontsize=8, color=ink)
    axes.invert_yaxis()
    axes.set_title(metric.heading)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def _line(row: Row) -> Line:
    condition = _condition(row)
    return condition.network, condition.rtt_ms, None if row.kind == "original" else row.model


def _label(line: Line) -> str:
    network, rtt, model = line
    parts = (short(network), None if rtt is None else f"{rtt:g} ms", None if model is None else short(model))
    return "\n".join(part for part in parts if part is not None)


def _condition(row: Row) -> Condition:
    assert row.condition is not None
    return row.condition


def rate_distortion_plot(found: RateDistortion, looks: Looks, where: str) -> Plot | None:
    """Quality against rate: a curve through fixed rungs, a point for each adaptive controller. None without points."""
    metrics = [
        metric
        for metric in QUALITIES
        if any(series.mean(controller, metric) for series in found.series for controller in series.controllers)
    ]
    if not metrics:
        return None
    figure, panels = panel_grid(len(metrics), columns=2)
    for axes, metric in zip(panels, metrics, strict=True):
        for series in found.series:
            _draw_series(axes, series, metric, looks)
        axes.set_title(f"{metric.heading} (higher is better)")
        _rate_axis(axes, found)
    label_lowest(panels, columns=2)
    caption = (
        f"Quality against received data, over {where}. Small points: blocks; large: their means, with 95 % confidence "
        "intervals from six blocks on. Lines: through the fixed rungs of a mode."
    )
    return finish(figure, panels, "rate-distortion", "Quality against rate", caption)


def _draw_series(axes: Axes, series: Series, metric: Metric, looks: Looks) -> None:
    colour = looks[series.controllers[0]].colour
    means: list[tuple[float, float]] = []
    for controller in series.controllers:
        blocks = [sample for sample in series.samples[controller].values() if metric in sample]
        rate, quality = (Estimate.over([sample[each] for sample in blocks]) for each in (RECEIVED, metric))
        if rate is None or quality is None:
            continue
        if len(blocks) > 1:
            rates, qualities = ([sample[each] for sample in blocks] for each in (RECEIVED, metric))
            axes.plot(rates, qualities, ".", color=colour, markersize=3, alpha=0.35)
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
