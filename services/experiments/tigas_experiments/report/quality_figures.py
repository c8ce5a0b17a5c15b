"""Heat maps of sampled pictures' scores: quality of the originals by metric, network and controller, and what
enhancement changes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from tigas_experiments.quality.metrics import PictureMetric
from tigas_experiments.report.captions import short
from tigas_experiments.report.controllers import in_order
from tigas_experiments.report.groups import Condition
from tigas_experiments.report.picture_scores import Row, computed
from tigas_experiments.report.plot import PAPER, Plot, style, svg

COLUMNS = 3
CELL_IN, LABELS_IN = (1.05, 0.5), (1.4, 0.75)
"""Width and height of a cell, and what is beside and above the cells, inches."""
Line = tuple[str, float | None, str | None]
"""A row of a map: the network, its round trip, and the model of a difference."""
DARK, LIGHT = "#101418", "#fdfdfd"
"""Text in a cell, which keeps its colour in a dark page."""


def heat_maps(rows: Sequence[Row]) -> Iterator[Plot]:
    """Of the originals; then, where there are enhanced pictures, of what they differ by."""
    originals = [row for row in rows if row.what == "original" and row.condition is not None]
    if any(row.values for row in originals):
        yield _plot("quality-heatmap", _best(originals), originals, "Frames as they came, enlarged by bicubic")
    differences = [row for row in rows if row.what == "difference" and row.condition is not None]
    if any(row.values for row in differences):
        what = "Enhanced pictures less the originals, sample by sample. Blue is better, red is worse"
        yield _plot("enhancement-heatmap", _changes(differences), differences, what)


def _plot(name: str, title: str, rows: Sequence[Row], what: str) -> Plot:
    metrics = computed(rows)
    lines = list(dict.fromkeys(_line(row) for row in rows))
    controllers = in_order(_condition(row).controller for row in rows)
    grid_rows = math.ceil(len(metrics) / COLUMNS)
    columns = min(len(metrics), COLUMNS)
    width = LABELS_IN[0] + CELL_IN[0] * len(controllers)
    height = LABELS_IN[1] + CELL_IN[1] * len(lines)
    with style():
        figure = Figure(figsize=(width * columns, height * grid_rows), layout="constrained")
        panels = figure.subplots(grid_rows, columns, squeeze=False).flatten().tolist()
        for spare in panels[len(metrics) :]:
            spare.remove()
        for axes, metric in zip(panels, metrics, strict=False):
            cells = {(_line(row), _condition(row).controller): row for row in rows}
            grid = [[cells.get((line, controller)) for controller in controllers] for line in lines]
            _draw(axes, metric, grid, signed=rows[0].what == "difference")
            axes.set_xticks([0.5 + x for x in range(len(controllers))], [short(one.title) for one in controllers])
            axes.set_yticks([0.5 + y for y in range(len(lines))], [_label(line) for line in lines])
        pictures = [mean.pictures for row in rows for metric in metrics if (mean := row.mean(metric)) is not None]
        low, high = min(pictures), max(pictures)
        counted = f"{low:,}" if low == high else f"{low:,} to {high:,}"
        variants = "; ".join(f"{metric.title}: {metric.variant}" for metric in metrics)
        caption = f"{what}; mean ± standard deviation over {counted} sampled pictures. {variants}."
        return Plot(name, title, caption, svg(figure), "picture_scores.csv")


def _draw(axes: Axes, metric: PictureMetric, grid: Sequence[Sequence[Row | None]], *, signed: bool) -> None:
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
    return condition.network, condition.rtt_ms, None if row.what == "original" else row.model


def _label(line: Line) -> str:
    network, rtt, model = line
    parts = (short(network), None if rtt is None else f"{rtt:g} ms", None if model is None else short(model))
    return "\n".join(part for part in parts if part is not None)


def _condition(row: Row) -> Condition:
    assert row.condition is not None
    return row.condition


def _best(rows: Sequence[Row]) -> str:
    """Who has the best pictures by most metrics, as means over networks."""
    by_controller: dict[str, list[Row]] = {}
    for row in rows:
        by_controller.setdefault(_condition(row).controller.title, []).append(row)
    metrics = computed(rows)
    wins = dict.fromkeys(by_controller, 0)
    for metric in metrics:
        means = {
            name: sum(found) / len(found)
            for name, own in by_controller.items()
            if (found := [mean.mean for row in own if (mean := row.mean(metric)) is not None])
        }
        choose = max if metric.better == "high" else min
        wins[choose(means, key=lambda name, means=means: means[name])] += 1  # type: ignore[misc]
    if len(wins) == 1:
        return f"{next(iter(wins))}: the quality of its frames"
    winner = max(wins, key=lambda name: wins[name])
    return f"{winner} has the best pictures by {wins[winner]} of {len(metrics)} metrics"


def _changes(rows: Sequence[Row]) -> str:
    """By how many metrics enhancement is better, over all samples."""
    texts, better = [], 0
    metrics = computed(rows)
    for metric in metrics:
        values = [value for row in rows for value in row.values.get(metric.name, ())]
        mean = sum(values) / len(values)
        better += mean > 0 if metric.better == "high" else mean < 0
        texts.append(f"{metric.title} {mean:+z.{metric.digits}f}{f' {metric.unit}' if metric.unit else ''}")
    return f"Enhancement is better by {better} of {len(metrics)} metrics: {', '.join(texts)}"
