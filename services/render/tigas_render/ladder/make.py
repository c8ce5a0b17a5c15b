"""The making of a scene's ladder, from the measurements to the file and plot (`tigas scene ladder`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from tigas_common.errors import StartError
from tigas_common.files import replace_file
from tigas_common.installation import install_command
from tigas_common.sample_cameras import SceneAxes
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_render.ladder.measure import CANDIDATES, Point, measure_views, random_walks
from tigas_render.raster.base import Rasterizer
from tigas_render.scenes.directory import read_source
from tigas_render.scenes.registry import BUILTIN
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import LADDER, LadderFile, SceneSource
from tigas_render.scenes.start_view.statistics import SceneStatistics

RUNGS, VIEWS = 10, 18
PAPER_SETTINGS = tuple((rung.width, rung.height, rung.quality) for rung in DEFAULT_LADDER)
INK, QUIET, ACCENT, OTHER = "#1c2430", "#c3c9d1", "#2166ac", "#d6604d"


@dataclass(frozen=True, slots=True)
class LadderResult:
    """A ladder, and the measurements behind it."""

    file: LadderFile
    candidates: Sequence[Point]
    paper_points: Sequence[Point]
    """Sizes and errors of the paper's rungs on the same views."""


def find_scene(name: str) -> SceneSource:
    """Find a scene by its folder or file, or a built-in scene by its id. Raises StartError."""
    path = Path(name)
    if path.exists():
        source = read_source(path.resolve())
        if source.error is not None:
            raise StartError(source.error)
        return source
    if name in BUILTIN:
        return BUILTIN[name]
    raise StartError(f"{name!r} is neither a scene's folder or file nor a built-in scene ({', '.join(BUILTIN)}).")


def ladder_path(source: SceneSource) -> Path:
    """Path of a scene's ladder.json. Raises StartError for a scene without a folder."""
    if source.folder is None:
        raise StartError(f"{source.id} has no folder: name the ladder's file with --out.")
    return source.folder / LADDER


def make_ladder(
    source: SceneSource, rasterizer: Rasterizer, listener: Listener, *, rungs: int = RUNGS, views: int = VIEWS
) -> LadderResult:
    """Measure a scene and choose its rungs. Raises StartError and BrokenScene."""
    gaussians, metadata = source.load(), source.metadata
    view = SceneStatistics.of(gaussians).view(metadata)
    prepared = rasterizer.prepare(gaussians)
    del gaussians
    poses = random_walks(SceneAxes.from_camera(view.camera, view.up), f"ladder of {source.id}")
    settings = list(dict.fromkeys((*CANDIDATES, *PAPER_SETTINGS)))
    points = measure_views(rasterizer, prepared, metadata.background, poses, settings, listener, views)
    found = dict(zip(settings, points, strict=True))
    candidates = [found[setting] for setting in CANDIDATES]
    file = LadderFile(rungs=choose_rungs(candidates, rungs), views=views, version=version("tigas"))
    return LadderResult(file, candidates, [found[setting] for setting in PAPER_SETTINGS])


def lower_hull(points: Sequence[Point]) -> list[Point]:
    """The lower convex hull of mean squared error over bytes, from the fewest bytes to the smallest error.

    No mixture of other settings has a smaller error at the same bytes. This is the hull of per-title encoding (Netflix,
    2015). PSNR over the logarithm of bytes is unsuitable, since almost all points are below the line between its ends.
    """
    kept: list[Point] = []
    for point in sorted(points, key=lambda point: (point.kb, point.mse)):
        if kept and point.mse >= kept[-1].mse:
            continue
        while len(kept) > 1 and _slope(kept[-2], point) <= _slope(kept[-2], kept[-1]):
            kept.pop()
        kept.append(point)
    return kept


def choose_rungs(points: Sequence[Point], number: int = RUNGS) -> tuple[Rung, ...]:
    """Choose up to `number` rungs, best first; fewer if the hull has fewer points.

    Rungs are on the hull, spaced as evenly as possible by the logarithm of bytes, so that no switch is a jump. None has
    more pixels than a better rung, so that less detail never takes longer to render.
    """
    kept = lower_hull(points)
    low, high = math.log(kept[0].kb), math.log(kept[-1].kb)
    chosen = [kept[-1]]
    for step in range(1, number):
        wanted = high + (low - high) * step / (number - 1)
        worse = [
            point
            for point in kept
            if point.kb < chosen[-1].kb and point.width * point.height <= chosen[-1].width * chosen[-1].height
        ]
        if not worse:
            break
        chosen.append(min(worse, key=lambda point: abs(math.log(point.kb) - wanted)))
    return tuple(to_rung(point) for point in chosen)


def psnr_at(kept: Sequence[Point], kb: float) -> float:
    """PSNR of a hull in dB at a size in kilobytes, for a mixture of frames with the two nearest settings."""
    mse = np.interp(kb, [point.kb for point in kept], [point.mse for point in kept])
    return 10 * math.log10(255**2 / float(mse))


def to_rung(point: Point) -> Rung:
    """Convert a setting to a rung, with its measured size and error."""
    return Rung(
        name=point.name,
        width=point.width,
        height=point.height,
        quality=point.quality,
        expected_kb=round(point.kb, 2),
        psnr_db=round(point.psnr_db, 2),
    )


def _slope(start: Point, end: Point) -> float:
    return (end.mse - start.mse) / (end.kb - start.kb)


def write_ladder(path: Path, file: LadderFile) -> None:
    """Write a ladder.json atomically. Raises OSError."""
    replace_file(path, f"{file.model_dump_json(indent=2)}\n".encode())


def check_plot(path: Path) -> None:
    """Raise StartError if matplotlib is missing, or if the file is neither PNG nor SVG."""
    if find_spec("matplotlib") is None:
        raise StartError(f"A plot needs matplotlib: {install_command('lab')}")
    if path.suffix.lower() not in (".png", ".svg"):
        raise StartError(f"{path} must end in .png or .svg.")


def plot_ladder(made: LadderResult, name: str, path: Path) -> None:
    """Plot a ladder and its measurements to a .png or .svg. Raises OSError."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    points, rungs = made.candidates, made.file.rungs
    axes.scatter(*_curve(points), s=6, color=QUIET, label="measured")
    axes.plot(*_curve(lower_hull(points)), color=INK, linewidth=0.8, label="hull")
    sizes, qualities = [rung.expected_kb for rung in rungs], [rung.psnr_db or 0 for rung in rungs]
    axes.scatter(sizes, qualities, s=36, color=ACCENT, zorder=3, label="rungs")
    for rung, size, quality in zip(rungs, sizes, qualities, strict=True):
        axes.annotate(rung.name, (size, quality), xytext=(4, -10), textcoords="offset points", fontsize=7, color=ACCENT)
    axes.scatter(*_curve(made.paper_points), s=36, marker="^", color=OTHER, zorder=3, label="the paper's")
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
