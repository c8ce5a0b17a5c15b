"""The picture of a ladder: PSNR over bytes of all that was measured, the hull, the chosen rungs, and the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from tigas_common.errors import StartError
from tigas_common.installation import install_command
from tigas_render.ladder.choose import hull
from tigas_render.ladder.make import Made
from tigas_render.ladder.measure import Point

INK, QUIET, ACCENT, OTHER = "#1c2430", "#c3c9d1", "#2166ac", "#d6604d"


def check_plot(path: Path) -> None:
    """Raises StartError without matplotlib, and for a file that is to be neither PNG nor SVG."""
    if find_spec("matplotlib") is None:
        raise StartError(f"A plot needs matplotlib: {install_command('lab')}")
    if path.suffix.lower() not in (".png", ".svg"):
        raise StartError(f"{path} must end in .png or .svg.")


def draw(made: Made, name: str, path: Path) -> None:
    """Write a .png or .svg. Raises OSError."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    points = made.candidates
    axes.scatter(
        [point.kb for point in points], [point.psnr_db for point in points], s=6, color=QUIET, label="measured"
    )
    best = hull(points)
    axes.plot([point.kb for point in best], [point.psnr_db for point in best], color=INK, linewidth=0.8, label="hull")
    rungs = made.file.rungs
    axes.scatter(
        [rung.expected_kb for rung in rungs],
        [rung.psnr_db or 0 for rung in rungs],
        s=36,
        color=ACCENT,
        zorder=3,
        label="rungs",
    )
    for rung in rungs:
        at = (rung.expected_kb, rung.psnr_db or 0)
        axes.annotate(rung.name, at, xytext=(4, -10), textcoords="offset points", fontsize=7, color=ACCENT)
    axes.scatter(*_curve(made.paper), s=36, marker="^", color=OTHER, zorder=3, label="the paper's")
    axes.set_xscale("log")
    axes.set_xticks(ticks := [1, 2, 5, 10, 20, 50, 100, 200, 500], [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_xlim(0.8 * min(point.kb for point in points), 1.4 * max(point.kb for point in points))
    axes.set_xlabel("size of a frame, kB")
    axes.set_ylabel("PSNR at 1280×720, dB")
    axes.set_title(name, loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e4e7eb", linewidth=0.6)
    axes.legend(frameon=False, loc="lower right")
    figure.savefig(path, dpi=150, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def _curve(points: Sequence[Point]) -> tuple[list[float], list[float]]:
    return [point.kb for point in points], [point.psnr_db for point in points]
