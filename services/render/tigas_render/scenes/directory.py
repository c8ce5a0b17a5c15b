"""The contents of a models directory: a folder or a single file per scene, read without loading any Gaussians.

A folder with a lod-meta.json is a streamed SOG scene, and the other files in it are its parts. Otherwise the scene is
the first of: the output of INRIA's training, `point_cloud/iteration_N/point_cloud.ply` with the highest N (the
`input.ply` in the same folder is not a 3DGS scene); a file with one of the ENDINGS, in the format of its content; the
meta.json of SOG. A folder may also have a `preview.jpg` or `preview.png`, a `scene.json` and a `ladder.json`. The id of
a single-file scene is the file's name without the ending. Hidden files (`.name`) are ignored.

Symbolic links are followed, even out of the directory, so that models may be on another disk. This is safe because
anybody who can create links here can write files as well, and clients refer to scenes only by id, never by path.
"""

from __future__ import annotations

import hashlib
import logging
import re
import unicodedata
from functools import lru_cache
from pathlib import Path

from tigas_common.errors import BrokenScene
from tigas_common.wire.render import Rung
from tigas_render.scenes.compressed_ply import is_compressed, read_compressed_ply
from tigas_render.scenes.ply import MAX_HEADER, read_ply
from tigas_render.scenes.scene_file import SceneFile, UnreadScene, read_start, translate_os_errors
from tigas_render.scenes.sog import read_sog
from tigas_render.scenes.sog_files import META, ZIP
from tigas_render.scenes.source import SceneMetadata, SceneSource, read_ladder, read_metadata, scene_id
from tigas_render.scenes.splat import looks_like_splat, read_splat
from tigas_render.scenes.spz import GZIP, MAGIC, read_spz
from tigas_render.scenes.streamed_sog import LOD_META, read_streamed_sog

_log = logging.getLogger(__name__)

_SAFE_NAME = re.compile(r"\w[\w .()+-]{0,127}")
FILE_EXTENSIONS = (".ply", ".sog", ".spz", ".splat")
"""Endings of possible scene files, before their content is checked; among several files, the first ending wins."""


def scan_directory(directory: Path) -> dict[str, SceneSource]:
    """All scenes of a models directory by id, including broken ones. Raises OSError, like `scene_paths`."""
    return {id: read_source(path) for id, path in sorted(scene_paths(directory).items())}


def scene_paths(directory: Path) -> dict[str, Path]:
    """The folder or file of each scene, by id; empty if the directory does not exist. Raises OSError."""
    try:
        entries = [path for path in directory.iterdir() if not path.name.startswith(".")]
    except FileNotFoundError:
        _log.warning("There is no models directory %s", directory)
        return {}
    paths: dict[str, Path] = {}
    for path in sorted((path for path in entries if _is_folder(path) or _is_scene_file(path)), key=_rank):
        id = path.name if _is_folder(path) else scene_id(path)
        if not is_safe_name(id):
            kind = "folder" if _is_folder(path) else "file"
            _log.warning("Skipped the %s %r: its name has characters that an id may not have", kind, path.name)
        elif id in paths:
            _log.warning("Skipped the file %s: there is another scene %s", path.name, id)
        else:
            paths[id] = path
    return paths


def is_safe_name(id: str) -> bool:
    """Whether a scene may have this id. Letters with combining marks, digits, spaces and _.()+- are allowed."""
    plain = "".join(character for character in id[1:] if not unicodedata.category(character).startswith("M"))
    return _SAFE_NAME.fullmatch(id[:1] + plain) is not None


def _rank(path: Path) -> tuple[int, str]:
    """A sort key: folders first, then files by ending, then by name."""
    return -1 if _is_folder(path) else FILE_EXTENSIONS.index(path.suffix.lower()), path.name


def _is_scene_file(path: Path) -> bool:
    try:
        return path.suffix.lower() in FILE_EXTENSIONS and path.is_file()
    except OSError:  # unreadable now, so `read_source` will report a broken scene
        return True


def _is_folder(path: Path) -> bool:
    """Whether a path is a folder; if it is unreadable, such as a link to an unreadable place, the name decides."""
    try:
        return path.is_dir()
    except OSError:
        return path.suffix.lower() not in FILE_EXTENSIONS


def read_source(path: Path) -> SceneSource:
    """The source of a scene in a folder or a single file. A broken scene has an `error`."""
    is_folder, metadata, version = _is_folder(path), SceneMetadata(), ""
    id = path.name if is_folder else scene_id(path)
    try:
        main = find_scene_file(path) if is_folder else path
        version = _version(main)
        metadata = read_metadata(path)
        file = read_scene_file(main)
        version = ",".join(map(_version, file.files))
        preview = next(filter(Path.is_file, (path / f"preview.{end}" for end in ("jpg", "jpeg", "png"))), None)
    except BrokenScene as error:
        return SceneSource(id, metadata, version, None, error.detail, is_unread=isinstance(error, UnreadScene))
    except OSError as error:
        is_unread, reason = not isinstance(error, FileNotFoundError), error.strerror or error
        return SceneSource(id, metadata, version, None, f"{id} cannot be read: {reason}.", is_unread=is_unread)
    except Exception:  # a faulty scene must not hide the others
        _log.exception("The scene %s was not read", id)
        return SceneSource(id, metadata, version, None, f"{id} could not be read; the server's log says why.")
    return SceneSource(
        id,
        metadata,
        version,
        open=lambda listener: read_scene_file(main).open(listener),
        gaussians=file.count,
        sh_degree=file.sh_degree,
        file_bytes=file.file_bytes,
        format=file.format,
        antialiased=file.antialiased,
        digest=lambda: _sha256(file.files),
        is_unchanged=lambda: _matches_files(version, file.files),
        coarse=file.coarse,
        memory_bytes=file.packed_bytes,
        folder=path if is_folder else None,
        preview=preview,
        ladder=_ladder(path),
    )


def _matches_files(version: str, files: tuple[Path, ...]) -> bool:
    try:
        return ",".join(map(_version, files)) == version
    except OSError:
        return False


def _version(path: Path) -> str:
    status = path.stat()
    return f"{path}:{status.st_size}:{status.st_mtime_ns}"


def _ladder(scene: Path) -> tuple[Rung, ...] | None:
    """The scene's own ladder; None if there is no usable one."""
    try:
        return read_ladder(scene)
    except BrokenScene as error:
        _log.warning("%s: %s The server's ladder is used instead.", scene.name, error.detail)
        return None


def _sha256(paths: tuple[Path, ...]) -> str:
    """The SHA-256 of a file; for several files, the SHA-256 of their digests."""
    digests = [_read_sha256(path, status.st_size, status.st_mtime_ns) for path in paths for status in (path.stat(),)]
    return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()


@lru_cache(maxsize=1024)
def _read_sha256(path: Path, size: int, modified_ns: int) -> str:
    """The SHA-256 of a file, cached while its size and time are unchanged, because it may have gigabytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_scene_file(path: Path) -> SceneFile:
    """Describe a scene's file in any format, identified by its content, or the file in its folder.

    path: of a SOG scene in several files, its meta.json; of a streamed one, its lod-meta.json. Raises BrokenScene, with
    one sentence.
    """
    with translate_os_errors(path):
        if path.is_dir():
            path = find_scene_file(path)
        start, file_bytes = read_start(path, MAX_HEADER)
        if not start:
            raise BrokenScene(f"{path.name} is empty.")
        if start.startswith(b"ply"):
            return read_compressed_ply(path) if is_compressed(start) else read_ply(path)
        if start.startswith((GZIP, MAGIC)):
            return read_spz(path)
        if start.startswith(ZIP):
            return read_sog(path, bundled=True)
        if path.name == LOD_META:
            return read_streamed_sog(path)
        if path.name == META or start.lstrip().startswith(b"{"):
            return read_sog(path, bundled=False)
        if looks_like_splat(start, file_bytes):
            return read_splat(path)
    raise BrokenScene(f"{path.name} is not a scene: it is neither PLY, SPZ, SOG nor .splat.")


def find_scene_file(folder: Path) -> Path:
    """The scene's file in a folder. Raises BrokenScene if there is no scene, and OSError."""
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
        endings = ", ".join(FILE_EXTENSIONS)
        raise BrokenScene(f"The folder {folder.name} has no scene: no {endings}, no {LOD_META} or {META} of SOG.")
    if len(files) > 1:
        _log.warning("%s has %d files that may be the scene; %s is used", folder.name, len(files), files[0].name)
    return files[0]
