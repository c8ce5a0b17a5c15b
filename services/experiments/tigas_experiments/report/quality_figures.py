"""Figures of picture quality: heat maps of sampled pictures' scores, and quality against rate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from tigas_experiments.quality.metrics import PictureMetric
from tigas_experiments.report.controllers import Controller, LineLook, sort_controllers
from tigas_experiments.report.estimates import MIN_WINDOWS, Estimate
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.metrics import Metric
from tigas_experiments.report.picture_scores import PictureKind, Row, computed_metrics, rows_of
from tigas_experiments.report.plot import PAPER, Plot, label_lowest, log_axis, panel_grid, shorten
from tigas_experiments.report.rate_distortion import QUALITIES, RECEIVED, RateDistortion, Series, over_all

CELL_IN, LABELS_IN = (1.05, 0.5), (1.4, 0.75)
"""Width and height of a cell, and of the labels, in inches."""
DARK, LIGHT = "#101418", "#fdfdfd"
"""Text colours of cells, which are the same on a dark page."""


def quality_heat_map(groups: Groups) -> Plot | None:
    return _heat_map(groups, "original", "quality-heatmap", "Quality of the frames", "Frames enlarged by bicubic")


def enhancement_heat_map(groups: Groups) -> Plot | None:
    """Differences between the scores of enhanced and original frames."""
    caption = "Enhanced pictures minus the originals, per sample. Blue is better, red is worse"
    return _heat_map(groups, "difference", "enhancement-heatmap", "Effect of enhancement", caption)


def _heat_map(groups: Groups, kind: PictureKind, name: str, title: str, caption: str) -> Plot | None:
    """A row for each network, round trip and, for differences, model; a column for each controller."""
    rows = [row for row in rows_of(groups) if row.kind == kind]
    metrics = computed_metrics(rows)
    if not metrics:
        return None
    cells = {}
    for row in rows:
        assert row.condition is not None
        network, rtt, controller = row.condition
        cells[(network, rtt, row.model), controller] = row
    lines = list(dict.fromkeys(line for line, _ in cells))
    controllers = sort_controllers(controller for _, controller in cells)
    grid = [[cells.get((line, controller)) for controller in controllers] for line in lines]
    labels = [
        "\n".join(
            (shorten(network), *([f"{rtt:g} ms"] if rtt is not None else []), *([shorten(model)] if model else []))
        )
        for network, rtt, model in lines
    ]
    width, height = LABELS_IN[0] + CELL_IN[0] * len(controllers), LABELS_IN[1] + CELL_IN[1] * len(lines)
    figure, panels = panel_grid(len(metrics), width=width, height=height)
    for axes, metric in zip(panels, metrics, strict=True):
        _draw_cells(axes, metric, grid, signed=kind == "difference")
        axes.set_xticks([0.5 + x for x in range(len(controllers))], [shorten(one.title) for one in controllers])
        axes.set_yticks([0.5 + y for y in range(len(lines))], labels)
    pictures = sorted(mean.pictures for row in rows for metric in metrics if (mean := row.mean(metric)) is not None)
    counted = " to ".join(dict.fromkeys((f"{pictures[0]:,}", f"{pictures[-1]:,}")))
    variants = "; ".join(f"{metric.title}: {metric.variant}" for metric in metrics)
    caption = f"{caption}; mean ± standard deviation over {counted} sampled pictures. {variants}."
    return Plot.from_figure(figure, panels, name, title, caption)


def _draw_cells(axes: Axes, metric: PictureMetric, grid: Sequence[Sequence[Row | None]], *, signed: bool) -> None:
    means = [[None if row is None else row.mean(metric) for row in line] for line in grid]
    values = [[math.nan if mean is None else mean.mean for mean in line] for line in means]
    known = [value for line in values for value in line if not math.isnan(value)]
    largest = max(map(abs, known)) or 1.0
    norm = Normalize(-largest, largest) if signed else Normalize(min(known), max(known))
    colours = mpl.colormaps[("RdBu" if signed else "cividis") + "_r" * (metric.better == "low")]
    axes.pcolormesh(values, cmap=colours, norm=norm, edgecolors=PAPER, linewidth=1.5)
    for y, line in enumerate(means):
        for x, mean in enumerate(line):
            if mean is not None:
                red, green, blue, _ = colours(0.5 if norm.vmin == norm.vmax else float(norm(mean.mean)))
                text = mean.text(metric, signed=signed).replace(" ± ", "\n± ")
                ink = DARK if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else LIGHT
                axes.text(x + 0.5, y + 0.5, text, ha="center", va="center", fontsize=8, color=ink)
    axes.invert_yaxis()
    axes.set_title(metric.heading)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def quality(groups: Groups, network: str) -> Plot | None:
    """Quality against rate; None without quality measurements."""
    found = RateDistortion.from_groups(groups.base(network), network, groups.base_rtt(network))
    return None if found is None else _rate_distortion(found, groups.looks, groups.base_title(network))


def quality_over_all(groups: Groups) -> Plot | None:
    """Quality against rate over all networks; None with fewer than two networks."""
    found = over_all(groups)
    return None if found is None else _rate_distortion(found, groups.looks, f"all networks, {groups.lowest_title}")


def _rate_distortion(found: RateDistortion, looks: Mapping[Controller, LineLook], where: str) -> Plot | None:
    """A curve through the fixed rungs of a mode, and a point for each adaptive controller."""
    rates = [rate for each in found.series for one in each.samples for rate in each.values(one, RECEIVED).values()]
    metrics = [
        metric
        for metric in QUALITIES
        if any(series.values(controller, metric) for series in found.series for controller in series.samples)
    ]
    figure, panels = panel_grid(len(metrics), columns=2)
    for axes, metric in zip(panels, metrics, strict=True):
        for series in found.series:
            _draw_series(axes, series, metric, looks)
        axes.set_title(f"{metric.heading} (higher is better)")
        axes.set_xlabel(RECEIVED.heading)
        log_axis(axes, "x", min(rates) / 1.3, max(rates) * 1.3)
    label_lowest(panels, columns=2)
    caption = (
        f"Quality against received data, over {where}. Small points: blocks; large: their means, with 95 % confidence "
        f"intervals from {MIN_WINDOWS} network windows on. Lines: through the fixed rungs of a mode."
    )
    return Plot.from_figure(figure, panels, "rate-distortion", "Quality against rate", caption)


def _draw_series(axes: Axes, series: Series, metric: Metric, looks: Mapping[Controller, LineLook]) -> None:
    colour = looks[next(iter(series.samples))].colour
    means: list[tuple[float, float]] = []
    for controller in series.samples:
        rates, qualities = series.values(controller, RECEIVED, metric), series.values(controller, metric)
        rate, quality = Estimate.from_blocks(rates), Estimate.from_blocks(qualities)
        if rate is None or quality is None:
            continue
        if len(rates) > 1:
            axes.plot([*rates.values()], [*qualities.values()], ".", color=colour, markersize=3, alpha=0.35)
        axes.errorbar(
            rate.mean,
            quality.mean,
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
