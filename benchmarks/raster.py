"""The CPU rasteriser: time per stage, frames/s per rung of the ladder, and how much faster it is than its slow twin.

    python -m benchmarks.raster [NAME=PLY …] [--cameras cameras.json]

Without a scene it takes the built-in courtyard. Every time is the median of the frames. `--cameras` names the cameras
that it renders from (name: position, look_at, up; vertical field of view 60 degrees); a scene without a camera there is
seen from where a visitor would start.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from rich.console import Console
from rich.table import Table

from benchmarks.views import centred_lens, chosen, look
from reference.rasterizer import ReferenceRasterizer
from tigas_common.command import POSITIONAL, Command, Metavar, parse
from tigas_common.pose import Pose
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer

FRAMES = 15
"""Frames that a median is taken of, after two that warm up."""
STAGES = ("project", "bin", "sort", "blend", "jpeg")


class Raster(Command):
    """Print one table a scene."""

    scenes: Annotated[tuple[str, ...], POSITIONAL, Metavar("NAME=PLY")] = ()
    """Scenes; the courtyard unless given."""
    cameras: Path | None = None
    """JSON with a camera for each scene."""
    reference: bool = False
    """Time the PyTorch reference as well, one frame at 640×360."""

    def run(self) -> None:
        rasterizer = CpuRasterizer()
        rasterizer.warm_up()
        for name, gaussians, view in chosen(list(self.scenes), self.cameras):
            pose = look(view)
            _report(name, gaussians, pose, rasterizer)
            if self.reference:
                _compare_with_reference(gaussians, pose, rasterizer)


def _report(name: str, gaussians: Gaussians, pose: Pose, rasterizer: CpuRasterizer) -> None:
    scene = rasterizer.prepare(gaussians)
    table = Table(title=f"{name}: {len(gaussians):,} Gaussians, SH degree {gaussians.sh_degree} (milliseconds)")
    for heading in ("rung", *STAGES, "raster", "frames/s"):
        table.add_column(heading, justify="right")
    for rung in DEFAULT_LADDER:
        camera = Camera(pose, centred_lens(rung.width, rung.height))
        times: list[dict[str, float]] = []
        for _ in range(FRAMES + 2):
            times.append(_staged(rasterizer, scene, camera, rung.quality))
        median = {stage: statistics.median(frame[stage] for frame in times[2:]) for stage in STAGES}
        raster = statistics.median(sum(frame.values()) - frame["jpeg"] for frame in times[2:])
        row = [f"{rung.width}×{rung.height} q{rung.quality}", *(f"{median[stage]:.1f}" for stage in STAGES)]
        row += [f"{raster:.1f}", f"{1000 / (raster + median['jpeg']):.0f}"]
        table.add_row(*row)
    Console(width=120).print(table)


def _staged(rasterizer: CpuRasterizer, scene: object, camera: Camera, quality: int) -> dict[str, float]:
    """Milliseconds of each stage of one frame."""
    times = dict.fromkeys(STAGES, 0.0)

    def timed(stage: str, call: Callable[[], object]) -> None:
        begin = time.perf_counter()
        call()
        times[stage] += 1000 * (time.perf_counter() - begin)

    job = rasterizer.start(scene, camera)  # type: ignore[arg-type]
    timed("project", lambda: rasterizer.project(job))
    while job.end < job.tiles:
        timed("bin", lambda: rasterizer.bin(job))
        timed("sort", lambda: rasterizer.sort(job))
        timed("blend", lambda: rasterizer.blend(job))
    with job.image as image:
        timed("jpeg", lambda: image.encode("jpeg", quality))
    return times


def _compare_with_reference(gaussians: Gaussians, pose: Pose, rasterizer: CpuRasterizer) -> None:
    camera = Camera(pose, centred_lens(640, 360))
    slow = ReferenceRasterizer()
    slow_scene, fast_scene = slow.prepare(gaussians), rasterizer.prepare(gaussians)
    begin = time.perf_counter()
    slow.render(slow_scene, camera).close()
    theirs = time.perf_counter() - begin
    ours = []
    for _ in range(FRAMES):
        begin = time.perf_counter()
        rasterizer.render(fast_scene, camera).close()
        ours.append(time.perf_counter() - begin)
    ratio = theirs / statistics.median(ours)
    print(f"PyTorch reference at 640×360: {theirs:.1f} s, {ratio:.0f}× the time of the CPU rasteriser\n")


if __name__ == "__main__":
    parse(Raster, "benchmarks.raster", sys.argv[1:]).run()
