"""The CPU rasteriser: time per stage, frames/s per rung of the ladder, and how much faster it is than its slow twin.

    python -m benchmarks.raster [NAME=PLY …] [--baseline cpu_baseline.py --cameras cameras.json]

Without a scene it takes the built-in courtyard. Every time is the median of the frames. A baseline takes turns with
ours in the same run; the ratio is between the best frame of each, which other work on the machine disturbs least.
`--baseline` names a module with `load`, `w2c` and `frame`, and `--cameras` the cameras it renders from (name: position,
look_at, up; vertical field of view 60 degrees); a scene without a camera there starts where a visitor would.
"""

from __future__ import annotations

import importlib.util
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.views import centred_lens, look, start_view
from tigas_common.pose import Pose
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.raster.reference import ReferenceRasterizer
from tigas_render.scenes.demo import demo_scene
from tigas_render.scenes.ply import load_ply

FRAMES = 15
"""Frames that a median is taken of, after two that warm up."""
STAGES = ("project", "bin", "sort", "blend", "jpeg")


def main(
    scenes: Annotated[list[str] | None, typer.Argument(metavar="NAME=PLY")] = None,
    baseline: Annotated[Path | None, typer.Option(help="A rasteriser to compare with in the same run.")] = None,
    cameras: Annotated[Path | None, typer.Option(help="JSON with a camera for each scene.")] = None,
    reference: Annotated[bool, typer.Option(help="Time the PyTorch reference too, one frame at 640×360.")] = True,
) -> None:
    """Print one table a scene."""
    views = json.loads(cameras.read_text()) if cameras else {}
    other = _module(baseline) if baseline else None
    rasterizer = CpuRasterizer()
    rasterizer.warm_up()
    for argument in scenes or ["courtyard="]:
        name, _, path = argument.partition("=")
        gaussians = load_ply(Path(path)) if path else demo_scene()
        pose = look(views.get(name) or start_view(gaussians, builtin=not path))
        rival = _rival(other, Path(path), views[name]) if other and name in views else None
        _report(name, gaussians, pose, rasterizer, rival)
        if reference:
            _compare_with_reference(gaussians, pose, rasterizer)


def _report(name: str, gaussians: Gaussians, pose: Pose, rasterizer: CpuRasterizer, rival: Rival | None) -> None:
    scene = rasterizer.prepare(gaussians)
    table = Table(title=f"{name}: {len(gaussians):,} Gaussians, SH degree {gaussians.sh_degree} (milliseconds)")
    for heading in ("rung", *STAGES, "raster", "frames/s", *(("best", "baseline's", "ratio") if rival else ())):
        table.add_column(heading, justify="right")
    for rung in DEFAULT_LADDER:
        camera = Camera(pose, centred_lens(rung.width, rung.height))
        times: list[dict[str, float]] = []
        rivals: list[float] = []
        for _ in range(FRAMES + 2):
            times.append(_staged(rasterizer, scene, camera, rung.quality))
            if rival:
                rivals.append(rival(rung.width, rung.height))
        median = {stage: statistics.median(frame[stage] for frame in times[2:]) for stage in STAGES}
        ours = [sum(frame.values()) - frame["jpeg"] for frame in times[2:]]
        raster = statistics.median(ours)
        row = [f"{rung.width}×{rung.height} q{rung.quality}", *(f"{median[stage]:.1f}" for stage in STAGES)]
        row += [f"{raster:.1f}", f"{1000 / (raster + median['jpeg']):.0f}"]
        if rivals:
            row += [f"{min(ours):.1f}", f"{min(rivals):.1f}", f"{min(rivals) / min(ours):.2f}×"]
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


Rival = Callable[[int, int], float]
"""Milliseconds of the better of two frames of a width and height."""


def _rival(module: ModuleType, path: Path, view: dict[str, list[float]]) -> Rival:
    scene = module.load(str(path))
    rotation, translation = module.w2c(view)

    def frame(width: int, height: int) -> float:
        lens = centred_lens(width, height)
        _, seconds = module.frame(scene, rotation, translation, lens.fx, lens.fy, lens.cx, lens.cy, width, height, n=3)
        return 1000 * float(seconds[-1])

    return frame


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("baseline", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    typer.run(main)
