"""Reads streamed SOG scenes of PlayCanvas: a lod-meta.json, and folders of SOG that each hold a part at one level.

The format, version 1: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/streamed-sog/. The finest
level of each part is read, and the environment around them all, which some published captures have without naming it.
The parts are read in sequence, so that only one part's images are in memory (see `sog`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tigas_common.errors import BrokenScene
from tigas_render.scenes.columns import Columns, Listener
from tigas_render.scenes.lod_meta import LOD_META, MAX_LOD_META, finest, parse_lod_meta
from tigas_render.scenes.scene_file import SceneFile
from tigas_render.scenes.sog import read_sog
from tigas_render.scenes.sog_files import META, Folder

FORMAT = "streamed SOG"
ENVIRONMENTS = ("environment.sog", f"environment/{META}")
"""The environment of a scene without one in its lod-meta.json."""


@dataclass(frozen=True, slots=True)
class _Part:
    """Some Gaussians of a file."""

    name: str
    """The file's, as the lod-meta.json has it."""
    file: SceneFile
    runs: tuple[range, ...]

    @property
    def count(self) -> int:
        return sum(map(len, self.runs))

    def decode(self, sh_degree: int, listener: Listener) -> Iterator[Columns]:
        chosen = np.zeros(self.file.count, np.bool_)
        for run in self.runs:
            chosen[run.start : run.stop] = True
        start = 0
        with _named(self.name):
            for columns in self.file.decode(listener):
                rows = chosen[start : start + len(columns)]
                start += len(columns)
                if rows.any():
                    yield columns.only(rows, sh_degree)


def read_streamed_sog(path: Path) -> SceneFile:
    """Description of the scene with this lod-meta.json. Raises BrokenScene, with one sentence."""
    content = Folder(path).read(LOD_META, MAX_LOD_META)
    meta = parse_lod_meta(path.name, content)
    environment = _environment(path.parent, meta.environment)
    parts = [_part(path, name, runs) for name, runs in finest(path.name, meta).items() if name != environment]
    if environment is not None:
        parts.append(_part(path, environment, None))
    if not parts:
        raise BrokenScene(f"{path.name} has 0 Gaussians, so there is nothing to show.")
    sh_degree = max(part.file.sh_degree for part in parts)
    return SceneFile(
        FORMAT,
        (path, *(file for part in parts for file in part.file.files)),
        sum(part.count for part in parts),
        sh_degree,
        len(content) + sum(part.file.file_bytes for part in parts),
        partial(_decode, parts, sh_degree),
        all(part.file.antialiased for part in parts),
    )


def _environment(folder: Path, named: str | None) -> str | None:
    """The environment's file: the named one, or one found in the scene's folder."""
    if named is not None:
        return f"{named}/{META}" if (folder / named).is_dir() else named
    return next((name for name in ENVIRONMENTS if (folder / name).is_file()), None)


def _part(scene: Path, name: str, runs: list[range] | None) -> _Part:
    """Without `runs`, all that is in the file."""
    with _named(name):
        file = read_sog(scene.parent / name, bundled=name.endswith(".sog"))
    runs = [range(file.count)] if runs is None else runs
    if runs[-1].stop > file.count:
        raise BrokenScene(f"{scene.name} takes {runs[-1].stop} Gaussians or more of {name}, which has {file.count}.")
    return _Part(name, file, tuple(runs))


def _decode(parts: list[_Part], sh_degree: int, listener: Listener) -> Iterator[Columns]:
    total, done = sum(part.count for part in parts), 0
    for part in parts:
        yield from part.decode(sh_degree, partial(_heard, listener, done, part.count, total))
        done += part.count


def _heard(listener: Listener, done: int, count: int, total: int, share: float) -> None:
    listener((done + count * share) / total)


@contextmanager
def _named(name: str) -> Iterator[None]:
    """Says which of the files is broken."""
    try:
        yield
    except BrokenScene as error:
        raise BrokenScene(f"{name}: {error.detail}") from None
