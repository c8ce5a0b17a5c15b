"""Contents of a models directory: a folder per scene, or a single file, read without loading any Gaussians.

A folder with a lod-meta.json is a scene of streamed SOG; other files in it are its parts. Otherwise the scene is the
output of INRIA's training, the `point_cloud/iteration_N/point_cloud.ply` with the highest N, since the `input.ply` in
the same folder is no 3DGS scene; else a file with a scene's ending (`formats.ENDINGS`), identified by its content; else
the meta.json of SOG. A folder may hold a `preview.jpg` or `preview.png`, a `scene.json` and a `ladder.json`. A single
file is a scene by its name without the ending. Hidden files (`.name`) are ignored.

Symbolic links are followed, also out of the directory, so that models may be on another disk: anybody able to create
links here could write files as well, and clients name scenes by id only, never by path.
"""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from tigas_common.errors import BrokenScene
from tigas_common.wire.render import Rung
from tigas_render.scenes.formats import ENDINGS, ending_rank, open_scene, read_scene_file
from tigas_render.scenes.ladder import FILE as LADDER_FILE
from tigas_render.scenes.ladder import BrokenLadder, read_ladder
from tigas_render.scenes.lod_meta import LOD_META
from tigas_render.scenes.metadata import SceneMetadata, read_metadata
from tigas_render.scenes.scene_file import SceneFile
from tigas_render.scenes.sog_files import META
from tigas_render.scenes.source import SceneSource

_log = logging.getLogger(__name__)

SAFE_NAME = re.compile(r"\w[\w .()+-]{0,127}")
"""Pattern of an id."""


def scan_directory(directory: Path) -> dict[str, SceneSource]:
    """Every scene of a models directory by id, broken ones included. A directory that cannot be read has none."""
    paths = scene_paths(directory)
    return {id: read_folder(path) if _is_folder(path) else read_single(path) for id, path in sorted(paths.items())}


def scene_paths(directory: Path) -> dict[str, Path]:
    """The folder or the file of each scene, by id."""
    try:
        entries = [path for path in directory.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        _log.warning("The models directory %s cannot be read: %s", directory, error.strerror or error)
        return {}
    paths: dict[str, Path] = {}
    for path in sorted(entries, key=_rank):
        folder = _is_folder(path)
        id = path.name if folder else scene_id(path)
        if not folder and not _is_scene_file(path):
            continue
        if not SAFE_NAME.fullmatch(id):
            what = "folder" if folder else "file"
            _log.warning("Skipped the %s %r: its name has characters that an id may not have", what, path.name)
        elif id in paths:
            _log.warning("Skipped the file %s: there is another scene %s", path.name, id)
        else:
            paths[id] = path
    return paths


def _rank(path: Path) -> tuple[bool, int, str]:
    """Folders first; of files with one name, the ending decides."""
    folder = _is_folder(path)
    return not folder, 0 if folder else ending_rank(path), path.name


def _is_scene_file(path: Path) -> bool:
    try:
        return ending_rank(path) < len(ENDINGS) and path.is_file()
    except OSError:
        return False


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:  # a link to an unreadable place: a scene that `read_folder` finds broken
        return True


def scene_id(path: Path) -> str:
    """Id of a single-file scene: its name without the ending."""
    return path.stem.removesuffix(".compressed")


def read_folder(folder: Path) -> SceneSource:
    """The source of a scene in a folder; a broken scene has an `error`."""
    return _read(folder.name, lambda: find_scene_file(folder), folder)


def read_single(path: Path) -> SceneSource:
    """The source of a single-file scene; a broken scene has an `error`."""
    return _read(scene_id(path), lambda: path, None)


def _read(id: str, find: Callable[[], Path], folder: Path | None) -> SceneSource:
    metadata, version, preview = SceneMetadata(), "", None
    try:
        path = find()
        version = _version(path)
        if folder is not None:
            metadata = read_metadata(folder)
        file = read_scene_file(path)
        version = ",".join(map(_version, file.files))
        if folder is not None:
            preview = next(filter(Path.is_file, (folder / f"preview.{end}" for end in ("jpg", "jpeg", "png"))), None)
    except BrokenScene as error:
        return SceneSource(id, metadata, version, None, error.detail)
    except OSError as error:
        return SceneSource(id, metadata, version, None, f"{id} cannot be read: {error.strerror or error}.")
    except Exception:  # so that a faulty scene does not hide the others
        _log.exception("The scene %s was not read", id)
        return SceneSource(id, metadata, version, None, f"{id} could not be read; the server's log says why.")
    return SceneSource(
        id,
        metadata,
        version,
        open=lambda listener: open_scene(path, listener),
        gaussians=file.count,
        sh_degree=file.sh_degree,
        file_bytes=file.file_bytes,
        format=file.format,
        antialiased=file.antialiased,
        digest=lambda: _sha256(file.files),
        memory_bytes=file.packed_bytes,
        folder=folder,
        preview=preview,
        ladder=None if folder is None else _ladder(folder),
    )


def _version(path: Path) -> str:
    status = path.stat()
    return f"{path}:{status.st_size}:{status.st_mtime_ns}"


def scene_file(path: Path) -> SceneFile:
    """Description of a scene's file, or of the one in a scene's folder. Raises BrokenScene and OSError."""
    return read_scene_file(find_scene_file(path) if path.is_dir() else path)


def _ladder(folder: Path) -> tuple[Rung, ...] | None:
    """Its own; None if it has none that can be used."""
    try:
        return read_ladder(folder / LADDER_FILE)
    except BrokenLadder as error:
        _log.warning("%s: %s It is shown with the server's ladder.", folder.name, error.detail)
        return None


def _sha256(paths: tuple[Path, ...]) -> str:
    """Of a file; of several, of their digests."""
    digests = [_read_sha256(path, status.st_size, status.st_mtime_ns) for path in paths for status in (path.stat(),)]
    return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()


@lru_cache(maxsize=1024)
def _read_sha256(path: Path, size: int, modified_ns: int) -> str:
    """Checksum of a file, cached while its size and time are unchanged: it may have gigabytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def find_scene_file(folder: Path) -> Path:
    """The scene's file in a folder. Raises BrokenScene if it has none, and OSError."""
    paths = {path.name: path for path in folder.iterdir()}
    if LOD_META in paths:
        return paths[LOD_META]
    iterations = [
        (int(match[1]), path / "point_cloud.ply")
        for path in folder.glob("point_cloud/iteration_*")
        if (match := re.fullmatch(r"iteration_(\d{1,9})", path.name)) and (path / "point_cloud.ply").is_file()
    ]
    if iterations:
        return max(iterations)[1]
    files = sorted(filter(_is_scene_file, paths.values()), key=_rank)
    if not files and (folder / META).is_file():
        return folder / META
    if not files:
        endings = ", ".join(ENDINGS)
        raise BrokenScene(f"The folder {folder.name} has no scene in it: no {endings}, no {LOD_META} or {META} of SOG.")
    if len(files) > 1:
        _log.warning("%s has %d files that may be the scene; %s is used", folder.name, len(files), files[0].name)
    return files[0]
