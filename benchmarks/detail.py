"""Levels of detail on a CPU: how much less is drawn of a large scene, how much faster, and how near to full detail.

    python -m benchmarks.detail [NAME=FILE …] [--copies 20] [--width 640 --height 360]

A scene is seen from where a visitor would start, and from 2, 4 and 8 times as far. Without scenes, somebody walks over
10 million made-up Gaussians on rolling hills. `--copies` draws each Gaussian so many times, a little apart and as much
smaller: small scenes get large. Times are medians of frames with levels and without, in turns; JPEG is left out.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.big_scene import write_ply
from benchmarks.gpu import densified
from benchmarks.views import View, centred_lens, look, start_view
from tests.render.raster.views import psnr
from tigas_common.pose import Pose
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.raster.cpu.levels import EDGE_PIXELS, FROM
from tigas_render.raster.cpu.scene import CpuScene
from tigas_render.raster.host_image import Pixels
from tigas_render.scenes.formats import open_scene

FRAMES = 5
TIMES_AS_FAR = (1, 2, 4, 8)
STEPS = 4
"""Places on the walk over the hills."""
FULL = 0.0


def main(
    scenes: Annotated[list[str] | None, typer.Argument(metavar="NAME=FILE")] = None,
    copies: Annotated[int, typer.Option(min=1, help="Of each Gaussian.")] = 1,
    count: Annotated[int, typer.Option(help="Gaussians of the hills.")] = 10_000_000,
    width: Annotated[int, typer.Option(help="Of pictures.")] = 640,
    height: Annotated[int, typer.Option(help="Of pictures.")] = 360,
) -> None:
    """Print a table, with a row a view."""
    table = Table()
    for heading in ("scene", "Gaussians", "view", "chunks drawn", "full, ms", "levels, ms", "times faster", "PSNR, dB"):
        table.add_column(heading, justify="right")
    rasterizer = CpuRasterizer()
    rasterizer.warm_up()
    for name, number, scene, views in chosen(scenes or [], copies, count, rasterizer):
        for where, pose in views.items():
            camera = Camera(pose, centred_lens(width, height))
            times: dict[float, list[float]] = {FULL: [], EDGE_PIXELS: []}
            for _ in range(FRAMES):
                for edge, spent in times.items():
                    begin = time.perf_counter()
                    drawn(rasterizer, scene, camera, edge)
                    spent.append(1000 * (time.perf_counter() - begin))
            full, some = (statistics.median(spent) for spent in times.values())
            (exact, all_chunks), (near, chunks) = (drawn(rasterizer, scene, camera, edge) for edge in times)
            table.add_row(
                name, f"{number:,}", where, f"{100 * chunks / max(1, all_chunks):.0f} %", f"{full:.0f}", f"{some:.0f}",
                f"{full / some:.1f}", f"{psnr(near, exact):.1f}",
            )  # fmt: skip
    Console(width=120).print(table)


def chosen(
    scenes: list[str], copies: int, count: int, rasterizer: CpuRasterizer
) -> Iterator[tuple[str, int, CpuScene, dict[str, Pose]]]:
    """Name, Gaussians, and views of each scene."""
    for argument in scenes:
        name, _, path = argument.partition("=")
        gaussians = open_scene(Path(path), lambda _: None).gathered()
        view = start_view(gaussians, builtin=False)
        if copies > 1:
            gaussians = densified(gaussians, copies)
        if len(gaussians) < FROM:
            raise typer.BadParameter(f"{name} has {len(gaussians):,} Gaussians, and levels begin at {FROM:,}.")
        poses = {f"{times}× as far": look(farther(view, times)) for times in TIMES_AS_FAR}
        yield name, len(gaussians), rasterizer.prepare(gaussians), poses
    if not scenes:
        with tempfile.TemporaryDirectory() as folder:
            hills = Path(folder) / "hills.ply"
            write_ply(hills, count, 0)
            scene = rasterizer.pack(open_scene(hills, lambda _: None))
        places = np.linspace(-40, 20, STEPS)
        walk = {f"step {i + 1}": Pose.look_at((0, -4, z), (0, 0, z + 20), (0, -1, 0)) for i, z in enumerate(places)}
        yield "hills", count, scene, walk


def farther(view: View, times: float) -> View:
    """The same view from `times` as far."""
    position, target = (np.array(view[name]) for name in ("position", "look_at"))
    return {**view, "position": (target + times * (position - target)).tolist()}


def drawn(rasterizer: CpuRasterizer, scene: CpuScene, camera: Camera, edge_pixels: float) -> tuple[Pixels, int]:
    """A frame, and how many chunks were looked at."""
    job = rasterizer.start(scene, camera, edge_pixels)
    rasterizer.project(job)
    while job.end < job.tiles:
        rasterizer.bin(job)
        rasterizer.sort(job)
        rasterizer.blend(job)
    with job.image as image:
        return image.to_host().copy(), len(job.chosen)


if __name__ == "__main__":
    typer.run(main)
