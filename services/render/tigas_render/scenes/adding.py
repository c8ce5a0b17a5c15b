"""Adds a scene to a models directory, from a file or a URL: whole and readable, or not at all."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote, urlsplit

import httpx

from tigas_common.errors import BrokenScene, TigasError
from tigas_common.files import check_room, open_regular
from tigas_render.scenes.directory import SAFE_NAME, scene_file, scene_id, scene_paths
from tigas_render.scenes.lod_meta import LOD_META
from tigas_render.scenes.registry import BUILTIN
from tigas_render.scenes.scene_file import SceneFile
from tigas_render.scenes.sog_files import META
from tigas_render.scenes.streamed_sog import FORMAT as STREAMED

Listener = Callable[[float], None]
"""Hears how much of a download is there, from 0 to 1."""

COPY_BYTES = 1 << 20
TIMEOUT_S = 30.0
AS_IT_IS = {"Accept-Encoding": "identity"}
ENDINGS = {"PLY": ".ply", "compressed PLY": ".compressed.ply", ".splat": ".splat", "SOG": ".sog", STREAMED: ""}
"""By format; all versions of SPZ are .spz, and SOG is one file from now on, unless it is streamed."""


class NotAdded(TigasError):
    """A scene that was not added."""

    status, type, title = 422, "scene-not-added", "The scene was not added"


def add_scene(source: str, directory: Path, id: str | None, listener: Listener) -> tuple[str, SceneFile]:
    """Copy a scene's file, or fetch it from an http(s) URL, check that it can be read, and put it into the directory.

    A scene of SOG in a folder becomes one file; a streamed one stays a folder, with the files that are read. Without
    `id`, the file's name says it. Returns the id, and what the scene's file is. Raises NotAdded, BrokenScene and
    OSError; then the directory is as it was.
    """
    url = urlsplit(source)
    remote = url.scheme in ("http", "https")
    id = id or (scene_id(Path(unquote(url.path))) if remote else _local_id(Path(source).resolve()))
    directory.mkdir(parents=True, exist_ok=True)
    check_free(directory, id)
    with _part(directory, id) as part:
        if remote:
            _fetch(source, part, listener)
        else:
            _copy(scene_file(Path(source)), part)
        return id, keep(part, directory, id)


def check_free(directory: Path, id: str) -> None:
    """Whether a scene can be called so. Raises NotAdded."""
    if not SAFE_NAME.fullmatch(id):
        raise NotAdded(f"{id[:100]!r} cannot be a scene's name: that has letters, digits, blanks and _.()+- alone.")
    if id in BUILTIN or id in scene_paths(directory):
        raise NotAdded(f"There is a scene {id} already; choose another name.")


def keep(part: Path, directory: Path, id: str) -> SceneFile:
    """Read all of a file on the directory's own disk, and make it a scene there. Raises as `add_scene` does."""
    file = scene_file(part)
    file.check()
    check_free(directory, id)
    path = directory / f"{id}{ENDINGS.get(file.format, '.spz')}"
    if part.is_dir():
        path.mkdir()
    else:
        path.open("x").close()
    part.replace(path)  # over what is ours, and nothing that came meanwhile
    return scene_file(path)


def keep_upload(part: Path, directory: Path, id: str, memory: int) -> None:
    """The same for a file from a stranger, in a process of its own, which may be ended.

    memory: what a scene may take, in bytes. Raises NotAdded, BrokenScene, and MemoryError.
    """
    try:
        needed = scene_file(part).packed_bytes
        if needed > memory:
            raise BrokenScene(
                f"{id} takes {needed / 1e6:.1f} MB in memory, and all scenes together may take {memory / 1e6:.1f} MB."
            )
        keep(part, directory, id)
    except OSError as error:
        raise NotAdded(f"{id} could not be kept: {error.strerror or error}.") from None
    except RuntimeError as error:  # PyTorch's for a lack of memory
        raise MemoryError from error


def _local_id(path: Path) -> str:
    if path.name in (META, LOD_META):
        return path.parent.name
    return path.name if path.is_dir() else scene_id(path)


@contextmanager
def _part(directory: Path, id: str) -> Iterator[Path]:
    """Where a file or a folder may be made that no scan takes for a scene; what is left there goes away."""
    hidden = Path(tempfile.mkdtemp(prefix=f".{id}.", dir=directory))
    try:
        yield hidden / id
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def _copy(file: SceneFile, part: Path) -> None:
    first = file.files[0]
    if file.format == STREAMED:
        for path in file.files:
            _copy_file(path, part / path.relative_to(first.parent))
    elif len(file.files) == 1:
        _copy_file(first, part)
    else:
        with zipfile.ZipFile(part, "w") as bundle:
            for path in file.files:
                bundle.write(path, path.name)


def _copy_file(path: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with open_regular(path) as source, target.open("wb") as copy:
        shutil.copyfileobj(source, copy, COPY_BYTES)


def _fetch(url: str, part: Path, listener: Listener) -> None:
    try:
        with (
            httpx.stream("GET", url, headers=AS_IT_IS, follow_redirects=True, timeout=TIMEOUT_S) as answer,
            part.open("wb") as target,
        ):
            if answer.status_code != 200:
                raise NotAdded(f"{url} answers with {answer.status_code} {answer.reason_phrase}.")
            size = int(answer.headers.get("Content-Length") or 0)
            got = 0
            for content in answer.iter_raw(COPY_BYTES):
                check_room(part.parent, max(len(content), size - got))
                got += len(content)
                target.write(content)
                if size:
                    listener(got / size)
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        reason = str(error).rstrip(".") or type(error).__name__
        raise NotAdded(f"{url} cannot be fetched: {reason}.") from None
