"""A scene's ladder from its folder to its file: `tigas scene ladder`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from tigas_common.errors import StartError
from tigas_common.files import replace_file
from tigas_common.sample_cameras import SceneAxes
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.ladder.choose import choose
from tigas_render.ladder.measure import CANDIDATES, Point, measure, walks
from tigas_render.raster.base import Rasterizer
from tigas_render.scenes.columns import Listener
from tigas_render.scenes.directory import read_folder, read_single
from tigas_render.scenes.ladder import FILE, LadderFile
from tigas_render.scenes.registry import BUILTIN
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_camera import derive_camera

PAPER = tuple((rung.width, rung.height, rung.quality) for rung in DEFAULT_LADDER)


@dataclass(frozen=True, slots=True)
class Made:
    """A ladder, and the measurements behind it."""

    file: LadderFile
    candidates: Sequence[Point]
    paper: Sequence[Point]
    """Bytes and errors of the paper's rungs on the same views."""


def find_scene(name: str) -> SceneSource:
    """A scene's folder or file, or a built-in scene by its id. Raises StartError."""
    path = Path(name)
    if path.exists():
        source = read_folder(path.resolve()) if path.is_dir() else read_single(path.resolve())
        if source.error is not None:
            raise StartError(source.error)
        return source
    if name in BUILTIN:
        return BUILTIN[name]
    raise StartError(f"{name!r} is neither a scene's folder or file nor a built-in scene ({', '.join(BUILTIN)}).")


def place_of(source: SceneSource) -> Path:
    """Path of a scene's ladder.json. Raises StartError for a scene without a folder."""
    if source.folder is None:
        raise StartError(f"{source.id} has no folder: name the ladder's file with --out.")
    return source.folder / FILE


def make(source: SceneSource, rasterizer: Rasterizer, listener: Listener, *, rungs: int = 10, views: int = 18) -> Made:
    """Measure a scene and choose its rungs. Raises StartError and BrokenScene."""
    gaussians, metadata = source.load(), source.metadata
    camera = metadata.camera or derive_camera(gaussians.means, gaussians.opacities, gaussians.scales, metadata.up)
    prepared = rasterizer.prepare(gaussians)
    del gaussians
    poses = walks(SceneAxes.of(camera, metadata.up), f"ladder of {source.id}")
    settings = list(dict.fromkeys((*CANDIDATES, *PAPER)))
    points = measure(rasterizer, prepared, metadata.background, poses, settings, listener, views)
    found = dict(zip(settings, points, strict=True))
    candidates = [found[setting] for setting in CANDIDATES]
    file = LadderFile(rungs=choose(candidates, rungs), views=views, version=version("tigas"))
    return Made(file, candidates, [found[setting] for setting in PAPER])


def write_ladder(path: Path, file: LadderFile) -> None:
    """Write a ladder.json in one step: a process that is killed meanwhile leaves the old one. Raises OSError."""
    replace_file(path, f"{file.model_dump_json(indent=2)}\n".encode())
