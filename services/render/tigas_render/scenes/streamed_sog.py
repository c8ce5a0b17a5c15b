"""Reads PlayCanvas' streamed SOG scenes: a lod-meta.json, and SOG files or folders that each have a part at one level.

The format, version 1: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/streamed-sog/. The scene
consists of the finest level of each part and of the environment around them, which some published captures have but do
not name. Its coarse scene has the coarsest levels. Parts are read one after the other, so that only one part's images
are in memory (see `sog`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from tigas_common.errors import BrokenScene, InvalidRequest
from tigas_common.parsing import parse
from tigas_common.wire.model import Entries
from tigas_render.scenes.scene_file import Columns, Listener, SceneFile, translate_os_errors
from tigas_render.scenes.sog import MAX_COUNT, PLAIN_NAME, read_sog
from tigas_render.scenes.sog_files import META, read_file

FORMAT = "streamed SOG"
LOD_META = "lod-meta.json"
MAX_LOD_META = 16 << 20
"""Maximum size in bytes; a leaf of the tree takes about 500."""
MAX_FILES = 4096
"""Maximum number of files of all levels; splat-transform puts half a million Gaussians into each."""
MIN_REDUCTION = 4
"""Factor by which the coarsest level must have fewer Gaussians than the finest to be useful."""
ENVIRONMENTS = ("environment.sog", f"environment/{META}")
"""Possible environments of a scene that does not name one in its lod-meta.json."""


def _check_name(name: str) -> str:
    if not all(map(PLAIN_NAME.fullmatch, name.split("/"))):
        raise ValueError(f"{name[:40]!r} is not a plain name of a file in a folder next to it")
    return name


def _strip_slash(name: object) -> object:
    return name.removesuffix("/") if isinstance(name, str) else name


Name = Annotated[str, Field(max_length=200), AfterValidator(_check_name)]
Level = Annotated[int, Field(ge=0, lt=64)]
"""Level of detail; 0 is the finest."""
Index = Annotated[int, Field(ge=0, le=MAX_COUNT)]
"""Index of a Gaussian in a file, or a number of Gaussians."""


@dataclass(frozen=True, slots=True)
class Run:
    """Consecutive Gaussians in a file."""

    file: int
    """Index of the file in `LodMeta.filenames`."""
    offset: Index
    count: Index


@dataclass(frozen=True, slots=True)
class Node:
    """A node of the tree: a leaf if it has levels of detail, otherwise the union of its children."""

    children: Entries[Node] = ()
    lods: dict[Level, Run] | None = None


class LodMeta(BaseModel):
    """The content of a lod-meta.json. Unknown fields are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    version: Literal[1] = 1
    """Missing in files that predate versions."""
    filenames: Annotated[Entries[Name], Field(max_length=MAX_FILES)]
    tree: Node
    environment: Annotated[Name, BeforeValidator(_strip_slash)] | None = None
    """The scene's environment, which is always drawn: a SOG file, a meta.json, or its folder."""


@dataclass(frozen=True, slots=True)
class _Part:
    """A selection of Gaussians from one file."""

    name: str
    """Name of the file in the lod-meta.json."""
    file: SceneFile
    runs: list[range]

    @property
    def count(self) -> int:
        return sum(map(len, self.runs))

    def decode(self, sh_degree: int, listener: Listener) -> Iterator[Columns]:
        chosen = np.zeros(self.file.count, np.bool_)
        for run in self.runs:
            chosen[run.start : run.stop] = True
        start = 0
        with _prefix_errors(self.name):
            for columns in self.file.decode(listener):
                rows = chosen[start : start + len(columns)]
                start += len(columns)
                if rows.any():
                    yield columns.select(rows, sh_degree)


def read_streamed_sog(path: Path) -> SceneFile:
    """Describe the scene with this lod-meta.json. Raises BrokenScene, with one sentence."""
    meta, meta_bytes = _read(path)
    finest = _at_level(min, path, meta, meta_bytes)
    return replace(finest, coarse=partial(_coarsest, finest, path, meta))


def all_files(path: Path) -> Iterator[Path]:
    """The lod-meta.json at this path, and all existing files of all levels and of the environment.

    Raises BrokenScene.
    """
    meta, _ = _read(path)
    environment = _find_environment(path.parent, meta.environment)
    yield path
    for name in dict.fromkeys((*meta.filenames, *((environment,) if environment else ()))):
        if (path.parent / name).is_file():
            yield from _read_part(path, name, None).file.files


def _read(path: Path) -> tuple[LodMeta, int]:
    """Read a lod-meta.json. Returns its content and its size in bytes. Raises BrokenScene."""
    content = read_file(path, MAX_LOD_META)
    try:
        return parse(LodMeta, content, MAX_LOD_META), len(content)
    except InvalidRequest as error:
        raise BrokenScene(f"{path.name} is not one of streamed SOG, version 1: {error.detail}") from None


def _coarsest(finest: SceneFile, path: Path, meta: LodMeta) -> SceneFile | None:
    """The scene at the coarsest level of each leaf; None if that saves little."""
    file = _at_level(max, path, meta, 0)
    return file if file.count * MIN_REDUCTION <= finest.count else None


def _at_level(level: Callable[[list[int]], int], path: Path, meta: LodMeta, meta_bytes: int) -> SceneFile:
    """The scene at the level of each leaf that `level` chooses. meta_bytes: the lod-meta.json's. Raises BrokenScene."""
    environment = _find_environment(path.parent, meta.environment)
    runs_of = _choose_runs(level, path.name, meta)
    parts = [_read_part(path, name, runs) for name, runs in runs_of.items() if name != environment]
    if environment is not None:
        parts.append(_read_part(path, environment, None))
    if not parts:
        raise BrokenScene(f"{path.name} has 0 Gaussians, so there is nothing to show.")
    sh_degree = max(part.file.sh_degree for part in parts)
    return SceneFile(
        FORMAT,
        (path, *(file for part in parts for file in part.file.files)),
        sum(part.count for part in parts),
        sh_degree,
        meta_bytes + sum(part.file.file_bytes for part in parts),
        partial(_decode, parts, sh_degree),
        all(part.file.antialiased for part in parts),
    )


def _choose_runs(level: Callable[[list[int]], int], name: str, meta: LodMeta) -> dict[str, list[range]]:
    """The Gaussians of each file that belong to the chosen level of a leaf, in file order. Raises BrokenScene."""
    chosen: dict[str, list[range]] = {}
    waiting = [meta.tree]
    while waiting:
        node = waiting.pop()
        if node.lods is None:
            waiting.extend(reversed(node.children))
            continue
        levels = [number for number, run in node.lods.items() if run.count]
        if not levels:
            continue
        run = node.lods[level(levels)]
        if not 0 <= run.file < len(meta.filenames):
            raise BrokenScene(f"{name} takes Gaussians from file {run.file}, and names {len(meta.filenames)} files.")
        chosen.setdefault(meta.filenames[run.file], []).append(range(run.offset, run.offset + run.count))
    for file, runs in chosen.items():
        runs.sort(key=lambda run: run.start)
        if any(before.stop > after.start for before, after in pairwise(runs)):
            raise BrokenScene(f"{name} takes some Gaussians of {file} twice.")
    return chosen


def _find_environment(folder: Path, named: str | None) -> str | None:
    """Name of the environment's file: as in the lod-meta.json, or found in the scene's folder."""
    if named is not None:
        return f"{named}/{META}" if (folder / named).is_dir() else named
    return next((name for name in ENVIRONMENTS if (folder / name).is_file()), None)


def _read_part(scene: Path, name: str, runs: list[range] | None) -> _Part:
    """Read the description of a part: these runs of the named file, or all of it. Raises BrokenScene."""
    with _prefix_errors(name):
        file = read_sog(scene.parent / name, bundled=name.endswith(".sog"))
    runs = [range(file.count)] if runs is None else runs
    if runs[-1].stop > file.count:
        raise BrokenScene(f"{scene.name} takes {runs[-1].stop} Gaussians or more of {name}, which has {file.count}.")
    return _Part(name, file, runs)


def _decode(parts: list[_Part], sh_degree: int, listener: Listener) -> Iterator[Columns]:
    total, done = sum(part.count for part in parts), 0
    for part in parts:
        yield from part.decode(sh_degree, partial(_report_progress, listener, done, part.count, total))
        done += part.count


def _report_progress(listener: Listener, done: int, count: int, total: int, share: float) -> None:
    listener((done + count * share) / total)


def find_streamable_file(folder: Path, name: str) -> Path | None:
    """The file that a client may read under this name in a scene's folder; None if there is no such file."""
    path = folder / name
    plain = all(map(PLAIN_NAME.fullmatch, name.split("/")))
    wanted = path.suffix in (".sog", ".webp") or path.name in (META, LOD_META)
    return path if plain and wanted and path.is_file() else None


@contextmanager
def _prefix_errors(name: str) -> Iterator[None]:
    """Prefix errors with the name of the broken file."""
    try:
        with translate_os_errors(Path(name)):
            yield
    except BrokenScene as error:
        raise BrokenScene(f"{name}: {error.detail}") from None
