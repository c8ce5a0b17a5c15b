"""How every plot of a report is drawn: one style, plain logarithmic axes, and SVG without dates or random ids, so that
equal data give equal files."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tigas_common.wire.figures import INTERACTIVE_MS

LineStyle = Literal["-", "--", ":", "-."]
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
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000)
DISTRIBUTION_POINTS = 200
"""Of a drawn distribution: more cannot be seen."""


@contextmanager
def style() -> Iterator[None]:
    """A context in which figures are made and written."""
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        # A name in a script that the font does not have is drawn as boxes; the page's text has it.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


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


def distribution(values: Sequence[float]) -> tuple[list[float], list[float]]:
    """The cumulative distribution as steps: (value, share of all that are at most as large). Infinite ones count."""
    finite = np.sort([value for value in values if math.isfinite(value)])
    if not len(finite):
        return [], []
    kept = np.unique(np.linspace(0, len(finite) - 1, min(len(finite), DISTRIBUTION_POINTS)).round().astype(int))
    return finite[kept].tolist(), ((kept + 1) / len(values)).tolist()


def interactive_limit(axes: Axes, *, horizontal: bool = False) -> None:
    """The line of 100 ms."""
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


def svg(figure: Figure) -> str:
    """Without the XML declaration, to be put into HTML."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata=NO_METADATA)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def for_a_page(drawing: str) -> str:
    """With the page's own colours for text and lines, so that it can be read in a dark page, too."""
    for colour, variable in IN_A_PAGE.items():
        drawing = drawing.replace(f": {colour}", f": {variable}")
    return drawing
