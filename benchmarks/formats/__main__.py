"""What each byte of a stateless frame buys: image formats against today's JPEG, at four sizes.

    python -m benchmarks.formats measure [NAME=PLY …] [--cameras cameras.json] [--out DIR]
    python -m benchmarks.formats report [--out DIR] [--plot FILE.svg]

`measure` takes the built-in courtyard, or the scenes named, and writes NAME.json for each into DIR (about two minutes
a scene); it needs Chromium, and for JPEG XL and jpegli `pip install imagecodecs pyjpegli`. `report` prints what lies in
DIR as Markdown. docs/formats.md has the results.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.formats.measure import Measured, measure
from benchmarks.formats.report import plot, tables
from benchmarks.views import chosen

Out = Annotated[Path, typer.Option(help="Where measurements lie.")]
SHOWN = ("JPEG", "JPEG, optimised Huffman", "jpegli", "WebP, method 1", "AVIF, speed 10")
"""In the plot."""
app = typer.Typer(add_completion=False, help=__doc__)


@app.command("measure")
def measure_scenes(
    scenes: Annotated[list[str] | None, typer.Argument(metavar="NAME=PLY")] = None,
    cameras: Annotated[Path | None, typer.Option(help="JSON with a camera for each scene.")] = None,
    out: Out = Path("formats"),
) -> None:
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


app()
