"""How wide the low-pass filter of lower rungs should be: the error of the shown picture while the view slides.

    python -m benchmarks.low_pass [NAME=PLY …] [--cameras cameras.json]

Varies the share that `footprint` takes of the box filter's variance (docs/picture.md). The view slides by sixths of the
rung's pixels; pictures are scaled up by a bicubic filter, without JPEG. Prints the RMS error against full-size renders,
and in brackets its part that changes from frame to frame (flicker), in 8-bit steps. The last rows are what a
calculation expects of natural pictures: RMS error, relative to the least of these shares. Scenes as for
benchmarks.footprint.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated
from unittest.mock import patch

import numpy as np
import typer
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console
from rich.table import Table

from benchmarks.views import centred_lens, chosen, look
from tigas_common.pose import Pose
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.raster.base import DILATION, Camera, PreparedScene
from tigas_render.raster.cpu import CpuRasterizer

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
STEPS = 6
"""Places within one of the rung's pixels."""
FULL, LOWER = DEFAULT_LADDER[0], DEFAULT_LADDER[1:]


def main(
    scenes: Annotated[list[str] | None, typer.Argument(metavar="NAME=PLY")] = None,
    cameras: Annotated[Path | None, typer.Option(help="JSON with a camera for each scene.")] = None,
) -> None:
    """Print one table."""
    rasterizer = CpuRasterizer()
    table = Table(title="RMS error (flicker) by the share of the box's variance")
    for heading in ("scene", "s", *map(str, SHARES)):
        table.add_column(heading, justify="right")
    for name, gaussians, view in chosen(scenes, cameras):
        pose = look(view)
        scene = rasterizer.prepare(gaussians)
        for rung in LOWER:
            scale = FULL.width / rung.width
            full = _slide(rasterizer, scene, pose, scale, 1)
            row = []
            for share in SHARES:
                filters = (DILATION / scale**2, _low_pass(share, scale))
                with patch("tigas_render.raster.cpu.view.footprint", return_value=filters):
                    errors = _slide(rasterizer, scene, pose, scale, scale) - full
                row.append(f"{np.sqrt(np.mean(errors**2)):.2f} ({np.sqrt(np.mean(errors.var(axis=0))):.2f})")
            table.add_row(name, f"{scale:g}", *row)
    for rung in LOWER:
        scale = FULL.width / rung.width
        errors = np.sqrt([expected_error(scale, _low_pass(share, scale)) for share in SHARES])
        table.add_row("1/f² (relative)", f"{scale:g}", *(f"{each:.2f}" for each in errors / errors.min()))
    Console(width=120).print(table)


def _low_pass(share: float, scale: float) -> float:
    """Variance in the picture's pixels²."""
    return share * (1 - 1 / scale**2) / 12


def expected_error(scale: float, low_pass: float) -> float:
    """Squared error that the shown picture has to expect, up to a factor, of natural pictures: power falls as 1/f².

    Sampling mixes the frequencies f + k for all whole k; bicubic interpolation (Keys 1981, a = -1/2) multiplies what
    comes out at each by its frequency response.
    """
    f = np.linspace(-3, 3, 400)  # of the picture's sampling rate; even, so without 0
    radius = f[:, None] ** 2 + f**2
    power = np.exp(-4 * np.pi**2 * radius * DILATION / scale**2) / radius
    passed = np.exp(-2 * np.pi**2 * radius * low_pass)
    response = np.multiply.outer(_bicubic(f), _bicubic(f))
    folded = np.sum([_bicubic(f + k) ** 2 for k in range(-4, 5)], axis=0)
    # (1 - H G)² at the frequency itself, and (H G)² at its aliases
    error = 1 - 2 * response * passed + np.multiply.outer(folded, folded) * passed**2
    return float(np.sum(power * error))


def _bicubic(f: NDArray[np.float64]) -> NDArray[np.float64]:
    """Frequency response of bicubic interpolation."""
    x = np.linspace(0, 2, 2001)
    near, far = 1.5 * x**3 - 2.5 * x**2 + 1, -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2
    kernel = np.where(x < 1, near, far)
    response: NDArray[np.float64] = 2 * np.trapezoid(kernel * np.cos(2 * np.pi * np.outer(f, x)), x, axis=1)
    return response


def _slide(
    rasterizer: CpuRasterizer, scene: PreparedScene, pose: Pose, step: float, scale: float
) -> NDArray[np.float32]:
    """[STEPS, H, W, 3] at full size: a view that slides by `step` pixels of it, on pictures `scale` times smaller."""
    lens, pictures = centred_lens(FULL.width, FULL.height), []
    for index in range(STEPS):
        moved = dataclasses.replace(lens, cx=lens.cx + step * index / STEPS)
        small = moved.resized(round(FULL.width / scale), round(FULL.height / scale))
        with rasterizer.render(scene, Camera(pose, small, display_scale=scale)) as image:
            shown = Image.fromarray(image.to_host()).resize((FULL.width, FULL.height), Image.Resampling.BICUBIC)
        pictures.append(np.asarray(shown, np.float32))
    return np.stack(pictures)


if __name__ == "__main__":
    typer.run(main)
