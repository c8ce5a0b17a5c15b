"""What lies in a models directory: one folder a scene, read without loading any Gaussians.

A scene's folder holds one `.ply` (of several, the first by name counts), or what INRIA's training writes: the
`point_cloud/iteration_N/point_cloud.ply` with the highest N, which goes before any other `.ply`, as the `input.ply`
beside it is no 3DGS scene. It may hold a `preview.jpg` or `preview.png`, a `scene.json`, and a `ladder.json`.

Symbolic links are followed, also out of the directory, so that models may lie on another disk: whoever can write links
here could as well write files, and clients name scenes by id only, never by path.
"""

from __future__ import annotations

import hashlib
import logging
import re
from functools import lru_cache
from pathlib import Path

from tigas_common.errors import BrokenScene
from tigas_common.wire.render import Rung
from tigas_render.scenes.ladder import FILE as LADDER_FILE
from tigas_render.scenes.ladder import BrokenLadder, read_ladder
from tigas_render.scenes.metadata import SceneMetadata, read_metadata
from tigas_render.scenes.ply import load_ply
from tigas_render.scenes.ply_header import read_header
from tigas_render.scenes.source import SceneSource

_log = logging.getLogger(__name__)

_SAFE_NAME = re.compile(r"\w[\w .()+-]{0,127}")


def scan_directory(directory: Path) -> dict[str, SceneSource]:
    """Every scene of a models directory by id, broken ones included. A directory that cannot be read has none."""
    try:
        paths = sorted(directory.iterdir())
    except OSError as error:
        _log.warning("The models directory %s cannot be read: %s", directory, error.strerror or error)
        return {}
    sources = {}
    for folder in filter(_is_folder, paths):
        if _SAFE_NAME.fullmatch(folder.name):
            sources[folder.name] = read_folder(folder)
        else:
            _log.warning(
                "Skipped the folder %r: its name is hidden or has characters that an id may not have", folder.name
            )
    return sources


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:  # a link to where nobody can look: a scene that `read_folder` finds broken
        return True


def read_folder(folder: Path) -> SceneSource:
    """One scene's source; a broken scene has an `error`."""
    metadata, version = SceneMetadata(), ""
    try:
        ply = find_ply(folder)
        status = ply.stat()
        version = f"{ply}:{status.st_size}:{status.st_mtime_ns}"
        metadata = read_metadata(folder / "scene.json")
        header = read_header(ply)
        preview = next(filter(Path.is_file, (folder / f"preview.{end}" for end in ("jpg", "jpeg", "png"))), None)
    except BrokenScene as error:
        return SceneSource(folder.name, metadata, version, None, error.detail)
    except OSError as error:
        sentence = f"{folder.name} cannot be read: {error.strerror or error}."
        return SceneSource(folder.name, metadata, version, None, sentence)
    except Exception:  # so that the others are found, whatever this one provokes
        _log.exception("%s was not read", folder)
        sentence = f"{folder.name} could not be read; the server's log says why."
        return SceneSource(folder.name, metadata, version, None, sentence)
    return SceneSource(
        folder.name,
        metadata,
        version,
        open=lambda: load_ply(ply),
        gaussians=header.count,
        sh_degree=header.sh_degree,
        file_bytes=header.file_bytes,
        digest=lambda: _sha256(ply),
        memory_bytes=header.tensor_bytes,
        folder=folder,
        preview=preview,
        ladder=_ladder(folder),
    )


def _ladder(folder: Path) -> tuple[Rung, ...] | None:
    """Its own; None if it has none that can be used."""
    try:
        return read_ladder(folder / LADDER_FILE)
    except BrokenLadder as error:
        _log.warning("%s: %s It is shown with the server's ladder.", folder.name, error.detail)
        return None


def _sha256(path: Path) -> str:
    status = path.stat()
    return _read_sha256(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=1024)
def _read_sha256(path: Path, size: int, modified_ns: int) -> str:
    """Of a file as long as its size and its time stay the same: it may have gigabytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def find_ply(folder: Path) -> Path:
    """The scene file of a folder. Raises BrokenScene if it has none."""
    iterations = [
        (int(match[1]), path / "point_cloud.ply")
        for path in folder.glob("point_cloud/iteration_*")
        if (match := re.fullmatch(r"iteration_(\d{1,9})", path.name)) and (path / "point_cloud.ply").is_file()
    ]
    if iterations:
        return max(iterations)[1]
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".ply" and path.is_file())
    if not files:
        raise BrokenScene(f"The folder {folder.name} has no .ply file.")
    if len(files) > 1:
        _log.warning("%s has %d .ply files; %s is used", folder.name, len(files), files[0].name)
    return files[0]
