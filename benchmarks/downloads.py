"""What a scene costs to download, and what the first part of a download looks like.

    python -m benchmarks.downloads [--scene NAME=PLY …] [--cameras cameras.json]

For each scene and form (docs/local.md): bytes, bytes a Gaussian, seconds to make, and PSNR in dB of what our rasteriser
draws of it against the scene itself, over views from the start camera and 25° to both sides, at 640×360 without JPEG;
then the same of the first rows, as they are and drawn larger as the file says, without the colours that change with the
direction where those come at the end.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.playcanvas_ply import read_compressed_ply
from benchmarks.views import View, centred_lens, chosen, look
from tigas_common.wire.render import DownloadForm, StartCamera
from tigas_render.downloads.files import FORMS, make
from tigas_render.downloads.order import SHARES, Order
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.metadata import SceneMetadata
from tigas_render.scenes.ply import load_ply
from tigas_render.scenes.source import SceneSource

TURNS_DEG = (-25, 0, 25)
LENS = centred_lens(640, 360)
Pictures = Sequence[NDArray[np.uint8]]


def main(
    scene: Annotated[list[str] | None, typer.Option(help="NAME=PLY; the demo scene if there is none.")] = None,
    cameras: Annotated[Path | None, typer.Option(help="JSON with a view for each name.")] = None,
) -> None:
    rasterizer = CpuRasterizer()
    forms = Table("scene", "Gaussians", "SH", "form", "MB", "bytes each", "made in s", "PSNR dB", title="Whole files")
    firsts = Table(
        "scene", "form", *(f"{share:.0%}" for share in SHARES), title="First rows: MB, PSNR dB, and enlarged"
    )
    for name, gaussians, view in chosen(scene, cameras):
        expected = pictures(rasterizer, gaussians, view)
        order = Order.of(gaussians, start(view).position)
        for form in FORMS:
            with tempfile.TemporaryDirectory() as directory:
                path = Path(directory) / "scene.ply"
                began = time.monotonic()
                made = make(source(name, gaussians, view), form, path)
                seconds = time.monotonic() - began
                read = reader(form, path)
                assert made.bytes is not None
                each = made.bytes / len(gaussians)
                quality = psnr(pictures(rasterizer, read(None), view), expected)
                sizes = (f"{made.bytes / 1e6:.1f}", f"{each:.1f}", f"{seconds:.1f}", f"{quality:.1f}")
                forms.add_row(name, str(len(gaussians)), str(gaussians.sh_degree), form, *sizes)
                row = 16 if form == "compressed" else each
                cells = []
                for part in order.parts:
                    first = read(part.count)
                    grown = replace(first, scales=first.scales * part.growth)
                    shown = [psnr(pictures(rasterizer, some, view), expected) for some in (first, grown)]
                    cells.append(f"{part.count * row / 1e6:.2f}: " + " → ".join(f"{each:.1f}" for each in shown))
                firsts.add_row(name, form, *cells)
    Console(width=120).print(forms, firsts)


def source(name: str, gaussians: Gaussians, view: View) -> SceneSource:
    """The scene as the service offers it."""
    return SceneSource(name, SceneMetadata(camera=start(view)), "1", lambda _: gaussians.batches())


def start(view: View) -> StartCamera:
    """Where its visitors start."""
    position, look_at = ((float(x), float(y), float(z)) for x, y, z in (view["position"], view["look_at"]))
    return StartCamera(position=position, look_at=look_at)


def reader(form: DownloadForm, path: Path) -> Callable[[int | None], Gaussians]:
    """What reads all of a file, or so many rows."""
    if form == "compressed":
        return lambda count: read_compressed_ply(path, count)
    whole = load_ply(path)
    return lambda count: Gaussians(*(array[:count] for array in whole.arrays))


def pictures(rasterizer: CpuRasterizer, gaussians: Gaussians, view: View) -> Pictures:
    prepared = rasterizer.prepare(gaussians)
    taken = []
    for turn in TURNS_DEG:
        with rasterizer.render(prepared, Camera(look(view, turn), LENS)) as image:
            taken.append(image.to_host().copy())
    return taken


def psnr(shown: Pictures, expected: Pictures) -> float:
    """Of all pictures together, in dB."""
    error = np.mean([(a.astype(np.float64) - b) ** 2 for a, b in zip(shown, expected, strict=True)])
    return 10 * math.log10(255**2 / max(float(error), 1e-9))


if __name__ == "__main__":
    typer.run(main)
