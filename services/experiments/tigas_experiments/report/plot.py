"""What every plot of a report is: in one style, and as SVG without dates or random ids, so that equal data give equal
files."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.figure import Figure

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
