"""The commands `tigas render` and `tigas scene`. Heavy imports wait until a command runs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tigas_common.cli import AllowHosts, AllowOrigins, in_a_sentence, log_to_stdout
from tigas_common.errors import StartError, TigasError
from tigas_common.settings import MODELS, load_settings
from tigas_common.terminal import make_console
from tigas_common.topology import PAGE, WEBTRANSPORT

if TYPE_CHECKING:
    from tigas_render.ladder.make import Made

scene = typer.Typer(help="Inspect, generate and preview scene files.", no_args_is_help=True)

_SCENE = typer.Argument(metavar="SCENE", help="A scene's file (PLY, compressed PLY, SOG, SPZ, .splat), or its folder.")


def render(
    scenes: Annotated[
        Path | None, typer.Option(help="Models directory: a folder or a file per scene.", show_default=str(MODELS))
    ] = None,
    lan: Annotated[
        bool | None,
        typer.Option("--lan", help="Serve other devices on the network, too, over HTTPS as well.", show_default="off"),
    ] = None,
    http: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Page and API.", show_default=str(PAGE.loopback))
    ] = None,
    https: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT", help="The same over HTTPS, for phones and other devices.", show_default="off"
        ),
    ] = None,
    quic: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="HTTP/3 and WebTransport, or 'off'.",
            show_default=f"localhost:{WEBTRANSPORT.number}",
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            metavar="auto|cpu|cuda[:N],…",
            help="Rasterise on this device, or on several; cuda: on all GPUs.",
            show_default="auto",
        ),
    ] = None,
    edges: Annotated[
        str | None,
        typer.Option(
            metavar="auto|N",
            help="Processes that speak with viewers, beside one a device that renders; 1: a single process does both, "
            "if there is one device.",
            show_default="auto",
        ),
    ] = None,
    ladder: Annotated[
        str | None,
        typer.Option(
            metavar="scene|paper", help="Quality levels: each scene's own, or the paper's.", show_default="scene"
        ),
    ] = None,
    congestion_control: Annotated[
        str | None, typer.Option(metavar="reno|cubic", help="QUIC's congestion control.", show_default="reno")
    ] = None,
    memory_gb: Annotated[
        float | None, typer.Option(help="Memory limit for loaded scenes on each device, in GB.", show_default="8")
    ] = None,
    idle_minutes: Annotated[
        float | None, typer.Option(help="Unload scenes that were unused for this long.", show_default="15")
    ] = None,
    upstreams: Annotated[
        list[str] | None,
        typer.Option(
            "--upstream",
            metavar="NAME=URL",
            help="Hand on what is asked under /services/NAME to dash, store or shaper, for pages that do not reach it: "
            "over HTTPS, or on other machines. Repeatable.",
        ),
    ] = None,
    edit_scenes: Annotated[
        bool | None,
        typer.Option(
            "--edit-scenes/--no-edit-scenes",
            help="Let pages add, rename and delete scenes.",
            show_default="if only this machine reaches the service",
        ),
    ] = None,
    allow_hosts: AllowHosts = None,
    allow_origins: AllowOrigins = None,
) -> None:
    """Serve scenes: open the printed URL, pick a scene and walk through it.

    Settings are also read from table `render` of tigas.toml (or the file that TIGAS_CONFIG names) and TIGAS_RENDER_*.
    """
    flags = dict(locals())
    from tigas_render.settings import RenderSettings

    settings = load_settings(RenderSettings, flags)

    import uvloop

    from tigas_render.transport.aioquic_version import check_aioquic

    log_to_stdout()
    logging.getLogger("quic").setLevel(logging.WARNING)  # aioquic tells the story of every connection
    with in_a_sentence(StartError):
        check_aioquic()
        from tigas_render.fleet.count import edges_for
        from tigas_render.fleet.devices import devices_for

        devices = devices_for(settings)
        number = edges_for(settings, len(devices))
        if number == len(devices) == 1:
            from tigas_render.main import serve

            uvloop.run(serve(settings))
        else:
            from tigas_render.fleet.supervisor import supervise

            uvloop.run(supervise(settings, devices, number))


@scene.command("info")
def info(path: Annotated[Path, _SCENE]) -> None:
    """Print what a scene's file contains."""
    import numpy as np
    from rich.table import Table

    from tigas_render.scenes.directory import scene_file
    from tigas_render.scenes.metadata import DEFAULT_UP
    from tigas_render.scenes.survey import Survey

    survey = Survey()
    with in_a_sentence(TigasError, OSError), _bar(f"reading {path}") as listener:
        file = scene_file(path)
        for _ in survey.watch(file.open(listener)).parts:
            pass
    camera, sample = survey.camera(DEFAULT_UP), survey.sample
    table = Table(show_header=False, box=None)
    table.add_row("format", f"{file.format}, {file.file_bytes / 1e6:.1f} MB")
    table.add_row("Gaussians", f"{survey.count:,}")
    table.add_row("SH degree", str(file.sh_degree))
    table.add_row("trained", "antialiased" if file.antialiased else "as 3DGS")
    table.add_row("memory", f"{file.packed_bytes / 1e6:.1f} MB")
    for axis, start, end in zip("xyz", survey.low, survey.high, strict=True):
        table.add_row(axis, f"{start:.3f} … {end:.3f}")
    table.add_row("median opacity", f"{np.median(sample.opacities):.3f}")
    table.add_row("median scale", f"{np.median(sample.scales):.4g}")
    table.add_row("start camera", _point(camera.position) + " → " + _point(camera.look_at))
    make_console().print(table)


@scene.command("add")
def add(
    source: Annotated[str, typer.Argument(metavar="FILE|URL", help="A scene's file or folder, or its address.")],
    scenes: Annotated[Path, typer.Option(help="Models directory.")] = MODELS,
    id: Annotated[str | None, typer.Option(help="What the scene is called.", show_default="the file's name")] = None,
) -> None:
    """Check a scene, and put it into the models directory."""
    from tigas_render.scenes.adding import add_scene

    with in_a_sentence(TigasError, OSError), _bar(f"fetching {source}") as listener:
        id, file = add_scene(source, scenes, id, listener)
    what = f"{file.format}, {file.count:,} Gaussians, SH degree {file.sh_degree}, {file.file_bytes / 1e6:.1f} MB"
    print(f"{file.files[0]}: {what}. A running service offers it as {id} once it has looked for new scenes.")


@scene.command("synth")
def synth(ply: Annotated[Path, typer.Argument(help="Output file.")]) -> None:
    """Write the built-in demo scene as a PLY."""
    from tigas_render.scenes.demo import demo_scene
    from tigas_render.scenes.ply import write_ply

    gaussians = demo_scene()
    with in_a_sentence(TigasError, OSError):
        write_ply(ply, gaussians)
    print(f"{ply}: {len(gaussians):,} Gaussians, SH degree {gaussians.sh_degree}")


@scene.command("preview")
def preview(
    path: Annotated[Path, _SCENE],
    image: Annotated[Path, typer.Argument(help="Output image: .jpg or .png.")],
    width: Annotated[int, typer.Option(min=1, max=8192)] = 640,
    height: Annotated[int, typer.Option(min=1, max=8192)] = 360,
) -> None:
    """Render a scene from its start camera."""
    from tigas_render.preview import preview_camera
    from tigas_render.raster.devices import create_rasterizer
    from tigas_render.scenes.directory import scene_file
    from tigas_render.scenes.metadata import DEFAULT_UP
    from tigas_render.scenes.survey import Survey

    survey = Survey()
    with in_a_sentence(TigasError, OSError):
        file, rasterizer = scene_file(path), create_rasterizer("auto")
        with _bar(f"reading {path}") as listener:
            scene = rasterizer.pack(survey.watch(file.open(listener)))
        camera = preview_camera(survey.camera(DEFAULT_UP), DEFAULT_UP, width, height)
        with rasterizer.render(scene, camera) as picture:
            image.write_bytes(picture.encode("png" if image.suffix.lower() == ".png" else "jpeg", 90))
    print(image)


@scene.command("ladder")
def ladder(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="A scene's folder, or a built-in scene: courtyard.")],
    out: Annotated[Path | None, typer.Option(help="Output file.", show_default="ladder.json beside the scene")] = None,
    plot: Annotated[Path | None, typer.Option(help="Also draw it: .png or .svg.")] = None,
    rungs: Annotated[int, typer.Option(min=2, max=16, help="How many, at most.")] = 10,
    views: Annotated[int, typer.Option(min=1, max=200, help="Views to measure on.")] = 18,
    device: Annotated[str, typer.Option(metavar="auto|cpu|cuda[:N]", help="Rasterise on this device.")] = "auto",
) -> None:
    """Measure the scene's own views at many sizes and qualities, and keep the best rungs as its ladder.json."""
    from tigas_render.ladder.make import find_scene, make, place_of, write_ladder
    from tigas_render.ladder.plot import check_plot, draw
    from tigas_render.raster.devices import create_rasterizer

    with in_a_sentence(StartError, TigasError, OSError, ValueError):
        source = find_scene(scene)
        path = out or place_of(source)
        if plot is not None:
            check_plot(plot)
        rasterizer = create_rasterizer(device)
        with _bar(f"measuring {source.name}") as listener:
            made = make(source, rasterizer, listener, rungs=rungs, views=views)
        write_ladder(path, made.file)
        if plot is not None:
            draw(made, source.name, plot)
    _print_ladder(made)
    print(path)


@contextmanager
def _bar(what: str) -> Iterator[Callable[[float], None]]:
    """A bar for whoever watches; hears how much is done, from 0 to 1."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeElapsedColumn(), TextColumn(what, markup=False))
    console = make_console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda done: bar.update(task, completed=done)


def _print_ladder(made: Made) -> None:
    """The rungs, and below them the paper's, each with what the hull gives at as many bytes."""
    from rich.table import Table

    from tigas_render.ladder.choose import hull, psnr_at

    table = Table("rung", "kB", "PSNR, dB", "the scene's at as many kB", box=None)
    for rung in made.file.rungs:
        table.add_row(rung.name, f"{rung.expected_kb:.1f}", f"{rung.psnr_db:.2f}", "")
    table.add_row("the paper's:")
    best = hull(made.candidates)
    for point in made.paper:
        table.add_row(point.name, f"{point.kb:.1f}", f"{point.psnr_db:.2f}", f"{psnr_at(best, point.kb):.2f}")
    make_console().print(table)


def _point(point: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in point) + ")"
