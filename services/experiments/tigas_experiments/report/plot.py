"""Style, panels, axes and legends of all plots, and reproducible SVG: no dates or random ids."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tigas_experiments.report.groups import Group
from tigas_experiments.report.metrics import IN_TIME, Metric
from tigas_experiments.wire.figures import INTERACTIVE_MS

INK, QUIET, GRID, AREA, PAPER = "#1c2430", "#8a929c", "#e4e7eb", "#eef0f3", "#ffffff"
IN_A_PAGE = {INK: "var(--ink)", QUIET: "var(--quiet)", GRID: "var(--grid)", AREA: "var(--area)", PAPER: "var(--paper)"}
"""Colours that a dark page replaces, with their variables in templates/style.css.j2."""
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
STYLE: Any = {
    "font.size": 9,
    "font.family": "sans-serif",
    "text.color": INK,
    "text.parse_math": False,  # names may contain dollar signs
    "axes.labelcolor": INK,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.edgecolor": QUIET,
    "axes.facecolor": "none",
    "xtick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.color": QUIET,
    "ytick.labelcolor": INK,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "figure.facecolor": PAPER,
    "legend.frameon": False,
    "svg.hashsalt": "tigas",
}
PANEL_IN, HEIGHT_IN = 3.5, 2.5
"""Panel size, inches."""
ALONE = 2.0
"""Width of a single panel, in panels."""
LEGEND_IN = 1.25
"""Width of a legend entry."""
MOST_COLUMNS = 3
NAME_LENGTH = 18
"""Maximum length of a name on an axis."""
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000)
LOGARITHMIC_FROM = 8.0
"""Ratio of times above which their axis is logarithmic."""


@contextmanager
def style() -> Iterator[None]:
    """The context in which figures are made and written."""
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        # Characters missing from the font are drawn as boxes; the page's text shows them.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


@dataclass(frozen=True, slots=True)
class Plot:
    """One figure of a report."""

    name: str
    """File name without .svg."""
    title: str
    caption: str
    svg: str

    @property
    def markup(self) -> Markup:
        """SVG for a page, with the page's colours for text and lines, which may be dark."""
        drawing = self.svg
        for colour, variable in IN_A_PAGE.items():
            drawing = drawing.replace(f": {colour}", f": {variable}")
        return Markup(drawing)  # matplotlib escapes text itself


def finish(figure: Figure, panels: Sequence[Axes], name: str, title: str, caption: str) -> Plot:
    """A plot of a figure with a common legend above its panels."""
    add_legend(figure, panels)
    return Plot(name, title, caption, svg(figure))


def svg(figure: Figure) -> str:
    """SVG without an XML declaration, for embedding in HTML."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata=NO_METADATA)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def panel_grid(
    count: int, *, width: float = 0.0, share: bool = False, columns: int = MOST_COLUMNS
) -> tuple[Figure, list[Axes]]:
    """A figure of `count` panels, each `width` times PANEL_IN wide; `share` gives all panels the same axes."""
    columns = min(count, columns)
    width = width or (ALONE if count == 1 else 1.0)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(width * PANEL_IN * columns, HEIGHT_IN * rows + 0.3), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=share, sharey=share).flatten().tolist()
    for spare in grid[count:]:
        spare.remove()
    return figure, grid[:count]


def add_legend(figure: Figure, panels: Iterable[Axes]) -> None:
    """One legend above all panels, each label once."""
    entries = {
        str(label): handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if entries:
        columns = max(2, int(figure.get_figwidth() / LEGEND_IN))
        figure.legend(entries.values(), entries.keys(), loc="outside upper left", ncols=columns, fontsize=8)


def label_lowest(panels: Sequence[Axes], *, columns: int = MOST_COLUMNS) -> None:
    """Keep the horizontal labels of only the lowest panel of each column."""
    for panel in panels[: max(0, len(panels) - columns)]:
        panel.tick_params(labelbottom=False)
        panel.set_xlabel("")


def metric_axis(axes: Axes, metric: Metric, values: Sequence[float]) -> None:
    """Title a panel with its metric and scale its vertical axis to the values."""
    profile = metric.name == "mean_profile"
    better = "" if metric.better is None or profile else f" ({metric.better}er is better)"
    axes.set_title(metric.heading + better)
    finite = [value for value in values if math.isfinite(value)]
    if metric.unit == "ms" and finite and min(finite) > 0 and max(finite) / min(finite) > LOGARITHMIC_FROM:
        plain_log(axes, finite)
    else:
        axes.set_ylim(bottom=0)
    if profile:
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_ylim(max([1.0, *finite]) + 0.2, -0.2)
    elif metric.name == IN_TIME:
        axes.set_ylim(0, 102)
    if metric.unit == "ms":
        interactive_limit(axes)


def extent(groups: Sequence[Group], metric: Metric) -> list[float]:
    """Lowest and highest value of each group, which an axis must cover."""
    spreads = [spread for group in groups if (spread := group.spread(metric))]
    return [value for spread in spreads for value in (spread.low, spread.high)]


def plain_log(axes: Axes, values: Iterable[float], *, horizontal: bool = False) -> None:
    """A logarithmic axis with plain numbers, which covers the values in ms and the interactive limit."""
    finite = [value for value in values if math.isfinite(value) and value > 0] or [INTERACTIVE_MS]
    low, high = min(20.0, *finite), max(200.0, *finite)
    ticks = [tick for tick in TICKS if low / 1.5 <= tick <= high * 1.5]
    axis, set_scale, set_limits = (
        (axes.xaxis, axes.set_xscale, axes.set_xlim) if horizontal else (axes.yaxis, axes.set_yscale, axes.set_ylim)
    )
    set_scale("log")
    axis.set_ticks(ticks, [f"{tick:,}" for tick in ticks])
    axis.set_ticks([], minor=True)
    set_limits(low / 1.1, high * 1.1)


def interactive_limit(axes: Axes, *, horizontal: bool = False) -> None:
    """A dashed line at INTERACTIVE_MS."""
    line: dict[str, Any] = {"color": INK, "linewidth": 0.8, "linestyle": "--", "zorder": 1}
    if horizontal:
        axes.axvline(INTERACTIVE_MS, **line)
    else:
        axes.axhline(INTERACTIVE_MS, **line)


def short(name: str) -> str:
    """A name shortened in the middle: its ends distinguish traces of one collection."""
    half = NAME_LENGTH // 2
    return name if len(name) <= NAME_LENGTH else f"{name[:half]}…{name[half + 1 - NAME_LENGTH :]}"
