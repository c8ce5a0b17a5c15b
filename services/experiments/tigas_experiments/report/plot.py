"""Style, panels, axes and legends of all plots, and reproducible SVG without dates or random ids."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from tigas_experiments.wire.figures import INTERACTIVE_MS

INK, QUIET, GRID, AREA, PAPER = "#1c2430", "#8a929c", "#e4e7eb", "#eef0f3", "#ffffff"
PAGE_VARS = {INK: "var(--ink)", QUIET: "var(--quiet)", GRID: "var(--grid)", AREA: "var(--area)", PAPER: "var(--paper)"}
"""Colours that change on a dark page, with their variables in templates/style.css.j2."""
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
"""Usual panel size in inches."""
WIDE_IN = 2.6 * PANEL_IN
LEGEND_IN, LETTER_IN = 0.55, 0.065
"""Width in inches of a legend entry without its text, and of a letter."""
MOST_COLUMNS = 3
NAME_LENGTH = 18
"""Maximum length of a name on an axis."""


@contextmanager
def plot_style() -> Iterator[None]:
    """Context in which figures are made and written."""
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        # Characters missing from the font are drawn as boxes; the page's text shows them.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


@dataclass(frozen=True, slots=True)
class Plot:
    name: str
    """File name without .svg."""
    title: str
    caption: str
    svg: str

    @classmethod
    def from_figure(cls, figure: Figure, panels: Sequence[Axes], name: str, title: str, caption: str) -> Plot:
        """A plot of a figure with a common legend above its panels."""
        add_legend(figure, panels)
        return cls(name, title, caption, svg(figure))

    @property
    def markup(self) -> Markup:
        """SVG for a page, with the page's colours for text and lines, which may be dark."""
        drawing = self.svg
        for colour, variable in PAGE_VARS.items():
            drawing = drawing.replace(f": {colour}", f": {variable}")
        return Markup(drawing)  # matplotlib escapes the text


def svg(figure: Figure) -> str:
    """SVG without an XML declaration, for embedding in HTML."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata=NO_METADATA)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def panel_grid(
    count: int,
    *,
    width: float | None = None,
    height: float = HEIGHT_IN,
    share: bool = False,
    columns: int = MOST_COLUMNS,
) -> tuple[Figure, list[Axes]]:
    """A figure of `count` panels of this size in inches; `share` gives all panels the same axes."""
    columns = min(count, columns)
    width = width or (2 * PANEL_IN if count == 1 else PANEL_IN)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(width * columns, height * rows + 0.3), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=share, sharey=share).flatten().tolist()
    for spare in grid[count:]:
        spare.remove()
    return figure, grid[:count]


def add_legend(figure: Figure, panels: Iterable[Axes]) -> None:
    """Add one legend above all panels, with each label once."""
    entries = {
        str(label): handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if entries:
        columns = max(1, int(figure.get_figwidth() / (LEGEND_IN + LETTER_IN * max(map(len, entries)))))
        figure.legend(entries.values(), entries.keys(), loc="outside upper left", ncols=columns, fontsize=8)


def label_lowest(panels: Sequence[Axes], *, columns: int = MOST_COLUMNS) -> None:
    """Keep horizontal labels only on the lowest panel of each column."""
    for panel in panels[: max(0, len(panels) - columns)]:
        panel.tick_params(labelbottom=False)
        panel.set_xlabel("")


def plain_log(axes: Axes, values: Iterable[float], *, horizontal: bool = False) -> None:
    """Make an axis logarithmic with plain numbers, covering the values in ms and the interactive limit."""
    finite = [value for value in values if math.isfinite(value) and value > 0] or [INTERACTIVE_MS]
    log_axis(axes, "x" if horizontal else "y", min(20.0, *finite) / 1.1, max(200.0, *finite) * 1.1)


def log_axis(axes: Axes, which: Literal["x", "y"], low: float, high: float) -> None:
    axes.set(**{f"{which}scale": "log", f"{which}lim": (low, high)})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(StrMethodFormatter("{x:,g}"))
    axis.set_minor_locator(NullLocator())


def interactive_limit(axes: Axes, *, horizontal: bool = False) -> None:
    """Draw a dashed line at INTERACTIVE_MS."""
    draw = axes.axvline if horizontal else axes.axhline
    draw(INTERACTIVE_MS, color=INK, linewidth=0.8, linestyle="--", zorder=1)


def shorten(name: str) -> str:
    """A name shortened in the middle, as its ends distinguish traces of one collection."""
    half = NAME_LENGTH // 2
    return name if len(name) <= NAME_LENGTH else f"{name[:half]}…{name[half + 1 - NAME_LENGTH :]}"
