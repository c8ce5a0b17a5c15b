"""The commands `tigas render` and `tigas scene`. Heavy imports are deferred until a command runs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tigas_common.cli import log_to_stdout, report_errors
from tigas_common.command import POSITIONAL, Command, Group, Metavar, load
from tigas_common.errors import StartError
from tigas_common.installation import check_versions
from tigas_common.processes import interrupt_on_sigterm
from tigas_common.terminal import make_console, progress_bar
from tigas_render.settings import RenderSettings

if TYPE_CHECKING:
    from tigas_render.ladder.make import LadderResult

PREVIEW_SIZE = (640, 360)
MAX_DOWNLOAD_BYTES = 10_000_000_000
"""Size limit of a scene that `tigas scene add` downloads."""


class Render(RenderSettings, Command):
    """Serve scenes: open the printed URL, pick a scene and walk through it."""

    def run(self) -> None:
        import uvloop

        log_to_stdout()
        logging.getLogger("quic").setLevel(logging.WARNING)  # aioquic logs every connection
        check_versions("aioquic", "uvicorn")
        from tigas_render.workers.devices import choose_devices, choose_edge_count

        devices = choose_devices(self)
        number = choose_edge_count(self, len(devices))
        if number == len(devices) == 1:
            from tigas_render.server.main import serve

            uvloop.run(serve(self))
        else:
            from tigas_render.workers.supervisor import supervise

            uvloop.run(supervise(self, devices, number))


class _SceneCommand(Command):
    """A command about a scene's file."""

    scene: Annotated[Path, POSITIONAL]
    """Scene file (PLY, compressed PLY, SOG, SPZ, .splat), or its folder."""


class Info(_SceneCommand):
    """Print the contents of a scene's file, and the scene.json of its folder."""

    def run(self) -> None:
        import numpy as np
        from rich.table import Table

        from tigas_render.scenes.directory import read_scene_file
        from tigas_render.scenes.source import read_metadata
        from tigas_render.scenes.start_view.statistics import SceneStatistics

        statistics = SceneStatistics()
        with _bar(f"reading {self.scene}") as listener:
            metadata, file = read_metadata(self.scene), read_scene_file(self.scene)
            for _ in statistics.collect(file.open(listener)).parts:
                pass
        view, sample = statistics.view(metadata), statistics.sample
        table = Table(show_header=False, box=None)
        if metadata.name is not None:
            table.add_row("name", metadata.name)
        table.add_row("format", f"{file.format}, {file.file_bytes / 1e6:.1f} MB")
        table.add_row("Gaussians", f"{statistics.count:,}")
        table.add_row("SH degree", str(file.sh_degree))
        table.add_row("trained", "antialiased" if file.antialiased else "as 3DGS")
        table.add_row("memory", f"{file.packed_bytes / 1e6:.1f} MB")
        for axis, start, end in zip("xyz", statistics.low, statistics.high, strict=True):
            table.add_row(axis, f"{start:.3f} … {end:.3f}")
        table.add_row("median opacity", f"{np.median(sample.opacities):.3f}")
        table.add_row("median scale", f"{np.median(sample.scales):.4g}")
        table.add_row("start camera", _point(view.camera.position) + " → " + _point(view.camera.look_at))
        table.add_row("up", _point(view.up))
        table.add_row("background", _point(metadata.background))
        make_console().print(table)


class Add(Command):
    """Check a scene, and put it into the models directory, the render service's setting `scenes`."""

    source: Annotated[str, POSITIONAL, Metavar("FILE|URL")]
    """Scene file or folder, or its URL."""
    id: Annotated[str | None, Metavar("NAME")] = None
    """Name of the scene; by default the file's name."""

    def run(self) -> None:
        from tigas_render.scenes.library_operations import add_scene, display_name

        with interrupt_on_sigterm(), _bar(f"fetching {display_name(self.source)}") as listener:
            id, file = add_scene(self.source, load(RenderSettings, {}).scenes, self.id, listener, MAX_DOWNLOAD_BYTES)
        what = f"{file.format}, {file.count:,} Gaussians, SH degree {file.sh_degree}, {file.file_bytes / 1e6:.1f} MB"
        print(f"{file.files[0]}: {what}. A running service offers it as {id} after its next scan.")


class Preview(_SceneCommand):
    """Render a scene from its start camera."""

    image: Annotated[Path, POSITIONAL]
    """Output image: .jpg or .png."""

    def run(self) -> None:
        from tigas_render.raster.devices import create_rasterizer
        from tigas_render.scenes.directory import read_scene_file
        from tigas_render.scenes.source import read_metadata
        from tigas_render.scenes.start_view.statistics import SceneStatistics
        from tigas_render.server.preview import preview_camera

        statistics = SceneStatistics()
        metadata, file = read_metadata(self.scene), read_scene_file(self.scene)
        rasterizer = create_rasterizer("auto")
        with _bar(f"reading {self.scene}") as listener:
            scene = rasterizer.pack(statistics.collect(file.open(listener)))
        view = statistics.view(metadata)
        camera = replace(preview_camera(view.camera, view.up, *PREVIEW_SIZE), background=metadata.background)
        with rasterizer.render(scene, camera) as picture:
            self.image.write_bytes(picture.encode("png" if self.image.suffix.lower() == ".png" else "jpeg", 90))
        print(self.image)


class Grid(_SceneCommand):
    """Write copies of a scene side by side on its ground plane, as a large scene to test with."""

    size: Annotated[str, POSITIONAL, Metavar("COLUMNSxROWS"), Field(pattern=r"^[1-9][0-9]?x[1-9][0-9]?$")]
    """Number of copies, such as 4x4."""
    out: Annotated[Path, POSITIONAL]
    """Output file, a compressed PLY: .ply."""

    def run(self) -> None:
        from tigas_render.scenes.copies import write_grid
        from tigas_render.scenes.directory import read_scene_file
        from tigas_render.scenes.source import read_metadata
        from tigas_render.scenes.start_view.statistics import SceneStatistics

        columns, rows = map(int, self.size.split("x"))
        if self.out.suffix.lower() != ".ply":
            raise StartError(f"{self.out} is a compressed PLY; its name must end in .ply.")
        metadata, file = read_metadata(self.scene), read_scene_file(self.scene)
        with _bar(f"reading {self.scene}") as listener:
            gaussians = file.open(listener).read_all()
        up = metadata.up or SceneStatistics.of(gaussians).view(metadata).up
        count = write_grid(self.out, gaussians, up, columns, rows)
        print(f"{self.out}: {count:,} Gaussians, {self.out.stat().st_size / 1e6:.1f} MB")


class Ladder(Command):
    """Measure the scene's own views at many sizes and qualities, and keep the best rungs as its ladder.json."""

    scene: Annotated[str, POSITIONAL]
    """Scene folder, or the built-in scene: courtyard."""
    out: Path | None = None
    """Output file; by default ladder.json next to the scene."""
    plot: Path | None = None
    """Plot to draw as well: .png or .svg."""

    def run(self) -> None:
        from tigas_render.ladder.make import check_plot, find_scene, ladder_path, make_ladder, plot_ladder, write_ladder
        from tigas_render.raster.devices import create_rasterizer

        with report_errors(ValueError):
            source = find_scene(self.scene)
            path = self.out or ladder_path(source)
            if self.plot is not None:
                check_plot(self.plot)
            rasterizer = create_rasterizer("auto")
            with _bar(f"measuring {source.name}") as listener:
                made = make_ladder(source, rasterizer, listener)
            write_ladder(path, made.file)
            if self.plot is not None:
                plot_ladder(made, source.name, self.plot)
        _print_ladder(made)
        print(path)


scene = Group(
    "Inspect, add, preview, measure and repeat scenes.",
    {"info": Info, "add": Add, "preview": Preview, "grid": Grid, "ladder": Ladder},
)


@contextmanager
def _bar(text: str) -> Iterator[Callable[[float], None]]:
    with progress_bar(text) as bar:
        yield lambda done: bar(done, text)


def _print_ladder(made: LadderResult) -> None:
    """Print the rungs, and below them the paper's rungs, each with the hull's PSNR at the same frame size."""
    from rich.table import Table

    from tigas_render.ladder.make import lower_hull, psnr_at

    table = Table("rung", "kB", "PSNR, dB", "the scene's at that size", box=None)
    for rung in made.file.rungs:
        table.add_row(rung.name, f"{rung.expected_kb:.1f}", f"{rung.psnr_db:.2f}", "")
    table.add_row("the paper's:")
    best = lower_hull(made.candidates)
    for point in made.paper_points:
        table.add_row(point.name, f"{point.kb:.1f}", f"{point.psnr_db:.2f}", f"{psnr_at(best, point.kb):.2f}")
    make_console().print(table)


def _point(point: tuple[float, float, float]) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in point) + ")"
