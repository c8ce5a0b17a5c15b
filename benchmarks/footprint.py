"""What rasterising for the display's size gains: PSNR of the shown picture against a full-size render, for each rung.

    python -m benchmarks.footprint [NAME=PLY …] [--cameras cameras.json]

Without a scene it takes the built-in courtyard. Each lower rung is a JPEG at the rung's quality, decoded, and scaled up
to the highest rung's size by a bicubic filter. `before` has training's dilation in the rung's own pixels, `now` is what
the service sends, and `bound` a full-size render that is averaged over the rung's pixels, which costs that render.
`--cameras` as for benchmarks.raster. Averages over three views, 15 degrees apart.
"""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console
from rich.table import Table

from benchmarks.views import centred_lens, chosen, look
from tigas_common.pose import Pose
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_render.encode.jpeg import encode_jpeg
from tigas_render.raster.base import Camera, PreparedScene
from tigas_render.raster.cpu import CpuRasterizer

Picture = NDArray[np.uint8]
TURNS = (0.0, 15.0, -15.0)
"""Degrees around what the camera looks at."""
FULL, *LOWER = DEFAULT_LADDER


def main(
    scenes: Annotated[list[str] | None, typer.Argument(metavar="NAME=PLY")] = None,
    cameras: Annotated[Path | None, typer.Option(help="JSON with a camera for each scene.")] = None,
) -> None:
    """Print one table."""
    rasterizer = CpuRasterizer()
    table = Table(title=f"PSNR on {FULL.width}×{FULL.height} in dB, and a frame's size in kilobytes")
    for heading in ("scene", "rung", "before", "now", "bound", "gain", "KB before", "KB now"):
        table.add_column(heading, justify="right")
    for name, gaussians, view in chosen(scenes, cameras):
        poses = [look(view, turned) for turned in TURNS]
        scene = rasterizer.prepare(gaussians)
        for rung in LOWER:
            measured = np.mean([_compare(rasterizer, scene, pose, rung) for pose in poses], axis=0)
            (before, kb_before), (now, kb_now), (bound, _) = measured.tolist()
            figures = (before, now, bound, now - before)
            label = f"{rung.width}×{rung.height} q{rung.quality}"
            row = [name, label, *(f"{each:.2f}" for each in figures), f"{kb_before:.1f}", f"{kb_now:.1f}"]
            table.add_row(*row)
    Console(width=120).print(table)


def _compare(rasterizer: CpuRasterizer, scene: PreparedScene, pose: Pose, rung: Rung) -> list[tuple[float, float]]:
    """PSNR in dB and kilobytes of a rung: before, now, and averaged."""

    def picture(width: int, height: int, display_scale: float = 1.0) -> Picture:
        camera = Camera(pose, centred_lens(width, height), display_scale=display_scale)
        with rasterizer.render(scene, camera) as image:
            return image.to_host().copy()

    full = picture(FULL.width, FULL.height)
    averaged = Image.fromarray(full).resize((rung.width, rung.height), Image.Resampling.BOX)
    corrected = picture(rung.width, rung.height, FULL.width / rung.width)
    return [
        _shown(each, rung.quality, full) for each in (picture(rung.width, rung.height), corrected, np.asarray(averaged))
    ]


def _shown(picture: Picture, quality: int, full: Picture) -> tuple[float, float]:
    """PSNR in dB against the full-size picture, and kilobytes."""
    jpeg = encode_jpeg(picture, quality)
    with Image.open(io.BytesIO(jpeg)) as image:
        shown = image.resize((full.shape[1], full.shape[0]), Image.Resampling.BICUBIC)
    error = np.mean((np.asarray(shown, np.float32) - full) ** 2)
    return 10 * math.log10(255**2 / float(error)), len(jpeg) / 1000


if __name__ == "__main__":
    typer.run(main)
