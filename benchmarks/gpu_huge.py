"""Huge scenes on the GPU: a captured one many times side by side, drawn at levels of detail and in full.

    python -m benchmarks.gpu_huge [--device cuda:0] [--grids 5x5 10x20] [--memory-gb 24] [--out results/huge]

Copies of *flowers* (without its view-dependent colour) stand in a grid on the ground; without the captured scenes, of
the courtyard. Three views are from among or next to them, the height of a flower above the ground, and one is from high
above. A walk leads through the middle. `--out` gets the pictures, the numbers, and a curve over the scenes' sizes.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.gpu import QUALITY, load_scenes, timed
from benchmarks.views import centred_lens
from tigas_common.pose import Pose
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.local_files import cache_directory
from tigas_render.raster.base import Camera
from tigas_render.raster.cuda import levels
from tigas_render.raster.cuda.rasterizer import CudaRasterizer
from tigas_render.raster.cuda.scene import CudaScene
from tigas_render.raster.devices import cuda_problem

LENS = centred_lens(1280, 720)
SPACING = 0.56
"""From copy to copy, in scene units: the captured patch is a little wider."""
STEPS = 60
"""Of a walk."""
UP = (0.0, -1.0, 0.0)
REPEATS = 100


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument(
        "--grids", nargs="*", default=["1x2", "5x4", "5x5", "9x10", "10x20", "22x42"], help="copies across and away"
    )
    parser.add_argument("--memory-gb", type=float, help="device memory that may be used")
    parser.add_argument("--out", type=Path, help="a folder for pictures, numbers and a curve (needs make lab)")
    arguments = parser.parse_args()
    if problem := cuda_problem():
        sys.exit(problem)
    with tempfile.TemporaryDirectory() as folder:
        scenes = load_scenes(Path(folder), ["flowers"])
    one, _ = scenes.get("flowers") or scenes["courtyard"]
    one = replace(one, sh=np.ascontiguousarray(one.sh[:, :1]))
    index = int(arguments.device.partition(":")[2] or 0)
    if arguments.memory_gb:
        whole = torch.cuda.get_device_properties(index).total_memory
        torch.cuda.set_per_process_memory_fraction(min(1.0, arguments.memory_gb * 1e9 / whole), index)
    print(f"{torch.cuda.get_device_name(index)}, 1280 x 720, quality {QUALITY}: p50 in ms, PSNR between them")
    rows = []
    for grid in arguments.grids:
        across, away = map(int, grid.split("x"))
        rows += report(CudaRasterizer(index, cache_directory()), one, across, away, arguments.out)
        gc.collect()  # the rasteriser's buffers
    if arguments.out:
        (arguments.out / "huge.json").write_text(json.dumps(rows, indent=1))
        draw_curve(rows, arguments.out / "huge.svg")


def report(
    rasterizer: CudaRasterizer, one: Gaussians, across: int, away: int, out: Path | None
) -> list[dict[str, Any]]:
    """Print one grid's numbers, and give those of its views."""
    with patch.object(levels, "FROM", math.inf):
        plain_s, scene = packed(rasterizer, one, across, away)
    plain_bytes = scene.nbytes
    del scene
    torch.cuda.reset_peak_memory_stats()
    seconds, scene = packed(rasterizer, one, across, away)
    peak = torch.cuda.max_memory_allocated()
    print(f"\n{grid_name(one, across, away)}: loaded in {seconds:.2f} s, without levels in {plain_s:.2f} s; ", end="")
    print(f"{scene.nbytes / 1e9:.2f} GB, without {plain_bytes / 1e9:.2f} GB, while loading {peak / 1e9:.1f} GB")
    for pose in walk(across, away):
        rasterizer.render(scene, Camera(pose, LENS))
    print(f"  buffers of a frame on the walk: {buffers(scene):.2f} GB")
    rows = []
    for name, pose in views(across, away).items():
        auto, full = Camera(pose, LENS), Camera(pose, LENS, full_detail=True)
        auto_ms, full_ms = (
            statistics.median(timed(partial(rasterizer.render, scene, camera, quality=QUALITY), REPEATS))
            for camera in (auto, full)
        )
        entries = [entries_of(rasterizer, scene, camera) / 1e6 for camera in (auto, full)]
        print(f"  {name:10} auto {auto_ms:7.2f}, full {full_ms:7.2f}, {psnr(rasterizer, scene, pose):.1f} dB; ", end="")
        print(f"{entries[0]:.1f} and {entries[1]:.1f} million entries", flush=True)
        rows.append({"gaussians": len(one) * across * away, "view": name, "auto_ms": auto_ms, "full_ms": full_ms})
        if out:
            out.mkdir(parents=True, exist_ok=True)
            (out / f"{across}x{away}-{name}.jpg").write_bytes(rasterizer.render(scene, auto).encode("jpeg", QUALITY))
    decibels = sorted(psnr(rasterizer, scene, pose) for pose in walk(across, away))
    print(f"  walk       median {statistics.median(decibels):.1f} dB, least {decibels[0]:.1f} dB")
    print(f"  buffers of a frame in full: {buffers(scene):.2f} GB", flush=True)
    return rows


def buffers(scene: CudaScene) -> float:
    """Gigabytes of one workspace."""
    return (torch.cuda.memory_allocated() - scene.nbytes) / 1e9


def draw_curve(rows: list[dict[str, Any]], path: Path) -> None:
    """The time of a frame over the size of the scene, by view and detail."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for number, view in enumerate(dict.fromkeys(row["view"] for row in rows)):
        of_view = [row for row in rows if row["view"] == view]
        for detail, style in (("auto", "o-"), ("full", "x:")):
            millions = [row["gaussians"] / 1e6 for row in of_view]
            axes.plot(
                millions, [row[f"{detail}_ms"] for row in of_view], style, color=f"C{number}", label=f"{view}, {detail}"
            )
    axes.set(xscale="log", yscale="log", xlabel="millions of Gaussians", ylabel="pose to JPEG at 1280×720, ms")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", ncols=2)
    figure.savefig(path, metadata={"Date": None})


def grid_name(one: Gaussians, across: int, away: int) -> str:
    return f"{across} x {away}, {len(one) * across * away / 1e6:.1f} million"


def packed(rasterizer: CudaRasterizer, one: Gaussians, across: int, away: int) -> tuple[float, CudaScene]:
    """A grid of copies, and the seconds that packing took."""
    started = time.perf_counter()
    scene = rasterizer.pack(Batches(len(one) * across * away, copies(one, across, away)))
    torch.cuda.synchronize()
    return time.perf_counter() - started, scene


def copies(one: Gaussians, across: int, away: int) -> Iterator[Gaussians]:
    for x in range(across):
        for z in range(away):
            moved = one.means + np.array([(x - (across - 1) / 2) * SPACING, 0, z * SPACING], np.float32)
            yield replace(one, means=moved)


# --- views ---


def views(across: int, away: int) -> dict[str, Pose]:
    right, far = across * SPACING / 2, away * SPACING
    return {
        "among": Pose.look_at((0.1, -0.3, 0.2 * far), (0.0, -0.1, 0.2 * far + 1.5), UP),
        "corner": Pose.look_at((-right, -0.45, -0.5), (0.3 * right, 0.0, 0.5 * far), UP),
        "side": Pose.look_at((right + 0.8, -0.35, 0.3 * far), (-right, 0.0, 0.6 * far), UP),
        "overview": Pose.look_at((-right - 0.25 * far, -0.45 * far, 0.5 * far), (0.0, 0.0, 0.5 * far), UP),
    }


def walk(across: int, away: int) -> Iterator[Pose]:
    """Through the middle, looking around."""
    for step in range(STEPS):
        z, turned = away * SPACING * (0.8 * step / STEPS), 0.7 * math.sin(step / 5)
        eye = (0.1 * math.sin(step / 3), -0.32 - 0.1 * math.sin(step / 7), z)
        yield Pose.look_at(eye, (eye[0] + math.sin(turned), -0.15, z + math.cos(turned)), UP)


# --- measures ---


def pixels(rasterizer: CudaRasterizer, scene: CudaScene, camera: Camera) -> NDArray[np.uint8]:
    return rasterizer.render(scene, camera, "png").to_host()


def psnr(rasterizer: CudaRasterizer, scene: CudaScene, pose: Pose) -> float:
    """Of the level of detail against the full detail."""
    drawn, exact = (pixels(rasterizer, scene, Camera(pose, LENS, full_detail=full)) for full in (False, True))
    error = float(np.mean((drawn.astype(np.float32) - exact) ** 2))
    return 10 * math.log10(255**2 / error) if error else math.inf


def entries_of(rasterizer: CudaRasterizer, scene: CudaScene, camera: Camera) -> int:
    """Of all tiles' lists: how much is drawn."""
    rasterizer.render(scene, camera)
    workspace = rasterizer.take_workspace()
    rasterizer.give_back(workspace)
    return workspace.entries


if __name__ == "__main__":
    main()
