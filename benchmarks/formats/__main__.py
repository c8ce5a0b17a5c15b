"""What each byte of a stateless frame buys: image formats against today's JPEG, at four sizes.

    python -m benchmarks.formats measure [NAME=PLY …] [--cameras cameras.json] [--out DIR]
    python -m benchmarks.formats report [--out DIR] [--plot FILE.svg]
    python -m benchmarks.formats served [NAME=PLY …] [--cameras cameras.json]

`measure` takes the built-in courtyard, or the scenes named, and writes NAME.json for each into DIR (about two minutes
a scene); it needs Chromium, and for JPEG XL and jpegli `pip install imagecodecs pyjpegli`. `report` prints what lies in
DIR as Markdown. `served` compares what the service sends at each rung: WebP instead of JPEG. docs/formats.md has the
results.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.formats.codecs import decoded
from benchmarks.formats.measure import Measured, measure, rendered
from benchmarks.formats.report import plot, tables
from benchmarks.views import chosen
from tigas_experiments.quality.picture import compare
from tigas_render.encode.jpeg import encode_jpeg
from tigas_render.encode.webp import encode_webp

Scenes = Annotated[list[str] | None, typer.Argument(metavar="NAME=PLY")]
Cameras = Annotated[Path | None, typer.Option(help="JSON with a camera for each scene.")]
Out = Annotated[Path, typer.Option(help="Where measurements lie.")]
SHOWN = ("JPEG", "JPEG, optimised Huffman", "jpegli", "WebP, method 1", "AVIF, speed 10")
"""In the plot."""
app = typer.Typer(add_completion=False, help=__doc__)


@app.command("measure")
def measure_scenes(scenes: Scenes = None, cameras: Cameras = None, out: Out = Path("formats")) -> None:
    """Measure scenes."""
    for name, gaussians, view in chosen(scenes, cameras):
        measure(name, gaussians, view, lambda doing: typer.echo(doing, err=True)).write(out)


@app.command()
def report(
    out: Out = Path("formats"),
    svg: Annotated[Path | None, typer.Option("--plot", help="Where to write the plot.")] = None,
) -> None:
    """Print the tables of what was measured."""
    found = [Measured.read(file) for file in sorted(out.glob("*.json"))]
    if not found:
        raise typer.BadParameter(f"{out} has no measurements: run `measure` first.")
    typer.echo(tables(found))
    if svg is not None:
        plot(found, SHOWN, svg)


@app.command()
def served(scenes: Scenes = None, cameras: Cameras = None) -> None:
    """Print what the service's own WebP is, compared with its JPEG."""
    for name, gaussians, view in chosen(scenes, cameras):
        for rung, pixels in rendered(gaussians, view):
            jpeg, webp = encode_jpeg(pixels, rung.quality), encode_webp(pixels, rung.quality)
            before, now = compare(decoded(jpeg), pixels), compare(decoded(webp), pixels)
            gains = f"PSNR {now.psnr_db - before.psnr_db:+.1f} dB, SSIM {now.ssim - before.ssim:+.3f}"
            bytes_ = f"{len(jpeg) / 1000:.1f} → {len(webp) / 1000:.1f} kB ({len(webp) / len(jpeg) - 1:+.0%})"
            typer.echo(f"{name} {rung.width}×{rung.height} q{rung.quality}: {bytes_}, {gains}")


app()
