"""How every plot of a report is drawn: its style, panels, axes and legend, and SVG without dates or random ids, so that
equal data give equal files."""

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

from tigas_common.wire.figures import INTERACTIVE_MS
from tigas_experiments.report.groups import Group
from tigas_experiments.report.metrics import IN_TIME, PROFILE, Metric

INK, QUIET, GRID, AREA, PAPER = "#1c2430", "#8a929c", "#e4e7eb", "#eef0f3", "#ffffff"
IN_A_PAGE = {INK: "var(--ink)", QUIET: "var(--quiet)", GRID: "var(--grid)", AREA: "var(--area)", PAPER: "var(--paper)"}
"""What a page may show in other colours when it is dark; the names are those of templates/style.css.j2."""
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
STYLE: Any = {
    "font.size": 9,
    "font.family": "sans-serif",
    "text.color": INK,
    "text.parse_math": False,  # a name may have a dollar sign
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
"""Of one panel, inches."""
ALONE = 2.0
"""How many times as wide a panel is that has no other beside it."""
LEGEND_IN = 1.25
"""What an entry of a legend takes."""
MOST_COLUMNS = 3
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000)
LOGARITHMIC_FROM = 8.0
"""Times that differ by more than this factor need a logarithmic axis."""


@contextmanager
def style() -> Iterator[None]:
    """A context in which figures are made and written."""
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        # A name in a script that the font does not have is drawn as boxes; the page's text has it.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


@dataclass(frozen=True, slots=True)
class Plot:
    """One figure of a report."""

    name: str
    """Of its file, without .svg."""
    title: str
    """What is seen."""
    caption: str
    """What is drawn, and over what."""
    svg: str
    values: str | None = None
    """The CSV file that has nothing but what is drawn."""

    @property
    def markup(self) -> Markup:
        """For a page, with the page's own colours for text and lines, so that it can be read in a dark page, too."""
        drawing = self.svg
        for colour, variable in IN_A_PAGE.items():
            drawing = drawing.replace(f": {colour}", f": {variable}")
        return Markup(drawing)  # matplotlib escapes text itself


def svg(figure: Figure) -> str:
    """Without the XML declaration, to be put into HTML."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata=NO_METADATA)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def panel_grid(
    count: int, *, width: float = 0.0, share: bool = False, columns: int = MOST_COLUMNS
) -> tuple[Figure, list[Axes]]:
    """A figure with so many panels, `width` times PANEL_IN wide; with `share`, all have the same axes."""
    columns = min(count, columns)
    width = width or (ALONE if count == 1 else 1.0)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(width * PANEL_IN * columns, HEIGHT_IN * rows + 0.3), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=share, sharey=share).flatten().tolist()
    for spare in grid[count:]:
        spare.remove()
    return figure, grid[:count]


def add_legend(figure: Figure, panels: Sequence[Axes]) -> None:
    """One above all panels."""
    entries = legend_entries(panels)
    if entries:
        columns = max(2, int(figure.get_figwidth() / LEGEND_IN))
        figure.legend(entries.values(), entries.keys(), loc="outside upper left", ncols=columns, fontsize=8)


def label_lowest(panels: Sequence[Axes], *, columns: int = MOST_COLUMNS) -> None:
    """Of panels above one another, the lowest says what all of them have from left to right."""
    for panel in panels[: max(0, len(panels) - columns)]:
        panel.tick_params(labelbottom=False)
        panel.set_xlabel("")


def metric_axis(axes: Axes, metric: Metric, values: Sequence[float]) -> None:
    """Name a panel after its figure, and let its vertical axis reach over the values."""
    better = {"low": "lower is better", "high": "higher is better", None: ""}[metric.better]
    axes.set_title(metric.heading + (f" ({better})" if better and metric is not PROFILE else ""))
    finite = [value for value in values if math.isfinite(value)]
    if metric.unit == "ms" and finite and min(finite) > 0 and max(finite) / min(finite) > LOGARITHMIC_FROM:
        plain_log(axes, finite)
    else:
        axes.set_ylim(bottom=0)
    if metric is PROFILE:
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_ylim(max([1.0, *finite]) + 0.2, -0.2)
    elif metric is IN_TIME:
        axes.set_ylim(0, 102)
    if metric.unit == "ms":
        interactive_limit(axes)


def extent(groups: Sequence[Group], metric: Metric) -> list[float]:
    """What an axis has to reach over."""
    spreads = [spread for group in groups if (spread := group.spread(metric))]
    return [value for spread in spreads for value in (spread.low, spread.high)]


def plain_log(axes: Axes, values: Iterable[float], *, horizontal: bool = False) -> None:
    """A logarithmic axis with plain numbers, over the values in ms and the interactive limit."""
    finite = [value for value in values if math.isfinite(value) and value > 0] or [INTERACTIVE_MS]
    low, high = min(20.0, *finite), max(200.0, *finite)
    ticks = [tick for tick in TICKS if low / 1.5 <= tick <= high * 1.5]
    if horizontal:
        axes.set_xscale("log")
    else:
        axes.set_yscale("log")
    axis = axes.xaxis if horizontal else axes.yaxis
    axis.set_ticks(ticks, [f"{tick:,}" for tick in ticks])
    axis.set_ticks([], minor=True)
    limits = (low / 1.1, high * 1.1)
    if horizontal:
        axes.set_xlim(*limits)
    else:
        axes.set_ylim(*limits)


def interactive_limit(axes: Axes, *, horizontal: bool = False) -> None:
    """The line of INTERACTIVE_MS."""
    line: dict[str, Any] = {"color": INK, "linewidth": 0.8, "linestyle": "--", "zorder": 1}
    if horizontal:
        axes.axvline(INTERACTIVE_MS, **line)
    else:
        axes.axhline(INTERACTIVE_MS, **line)


def legend_entries(panels: Iterable[Axes]) -> dict[str, Any]:
    """Label → handle, each label once."""
    return {
        str(label): handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
