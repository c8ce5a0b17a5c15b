"""Operations on a models directory: add, rename, edit and remove scenes.

A scene is added from a file or a URL, only if it is complete and readable. Ids are looked up among the directory's
scenes, so that no id can lead outside it.
"""

from __future__ import annotations

import errno
import json
import shutil
import time
import zipfile
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, unquote, urlsplit

import httpx

from tigas_common.errors import TigasError, UnknownScene
from tigas_common.files import check_free_space, flush_tree, move_new, open_regular, read_regular, replace_file
from tigas_common.limits import IdleTimeout
from tigas_common.parsing import parse
from tigas_common.wire.render import SceneEdit
from tigas_render.local_files import lock_directory, locked_directory
from tigas_render.scenes.directory import is_safe_name, read_scene_file, scene_paths
from tigas_render.scenes.registry import BUILTIN
from tigas_render.scenes.scene_file import Listener, SceneFile
from tigas_render.scenes.sog_files import META
from tigas_render.scenes.source import MAX_METADATA, SceneMetadata, metadata_path, read_metadata, scene_id
from tigas_render.scenes.streamed_sog import FORMAT as STREAMED
from tigas_render.scenes.streamed_sog import LOD_META, all_files

COPY_BYTES = 1 << 20
TIMEOUT_S = 30.0
"""Seconds without a byte after which a download is aborted."""
MIN_BYTES_PER_S = 1000.0
"""Rate, averaged over TIMEOUT_S, below which a download is aborted."""
PART_PREFIX = ".adding-"
"""Prefix of a temporary folder in the models directory for a scene that is being added."""
REMOVED_PREFIX = ".removed-"
"""Prefix of a temporary folder in the models directory for a scene that is being removed."""
MAX_ID_BYTES = 200
"""Less than the 255 bytes that file systems allow, to leave room for endings and names of temporary files."""
IDENTITY_ENCODING = {"Accept-Encoding": "identity"}
FILE_EXTENSIONS = {"PLY": ".ply", "compressed PLY": ".compressed.ply", ".splat": ".splat", "SOG": ".sog", STREAMED: ""}
"""File endings by format. All versions of SPZ are .spz, and SOG folders become a .sog file unless they are streamed."""


class SceneNotAdded(TigasError):
    """A scene that was not added."""

    status, type, title = 422, "scene-not-added", "The scene was not added"


def add_scene(source: str, directory: Path, id: str | None, listener: Listener, limit: int) -> tuple[str, SceneFile]:
    """Copy a scene's file, or download it from an http(s) URL, check that it is readable, and add it to the directory.

    id: by default the file's name without its ending. limit: maximum size of a download in bytes.

    A SOG scene in a folder becomes one file; a streamed one stays a folder, with all levels. Returns the id, and the
    scene's file. Raises SceneNotAdded, BrokenScene and OSError, all of which leave the directory unchanged.
    """
    url = _split_url(source)
    if url and url.scheme not in ("http", "https"):
        raise SceneNotAdded("Scenes are fetched from http and https addresses only.")
    id = id or (scene_id(Path(unquote(url.path))) if url else _local_id(Path(source).resolve()))
    directory.mkdir(parents=True, exist_ok=True)
    check_free(directory, id)
    with locked_directory(directory, PART_PREFIX) as hidden:
        part = hidden / id
        if url:
            _fetch(source, part, listener, limit)
        else:
            _copy(read_scene_file(Path(source)), part)
        return id, install_file(part, directory, id)


def check_free(directory: Path, id: str) -> None:
    """Raise SceneNotAdded if a new scene cannot have this id."""
    if not is_safe_name(id):
        raise SceneNotAdded(f"{id[:100]!r} cannot be a scene's name: use only letters, digits, spaces and _.()+-.")
    if (size := len(id.encode())) > MAX_ID_BYTES:
        raise SceneNotAdded(f"A scene's name has at most {MAX_ID_BYTES} bytes in UTF-8, and this one has {size}.")
    if (other := scene_id(Path(f"{id}.ply"))) != id:
        raise SceneNotAdded(f"{id} cannot be a scene's name: its file would be the scene {other}.")
    if id in BUILTIN or id in scene_paths(directory):
        raise SceneNotAdded(f"There is a scene {id} already; choose another name.")


def install_file(part: Path, directory: Path, id: str) -> SceneFile:
    """Check a whole file, and move it into the directory as a scene. Raises the same errors as `add_scene`."""
    file = read_scene_file(part)
    file.check()
    check_free(directory, id)
    path = directory / f"{id}{FILE_EXTENSIONS.get(file.format, '.spz')}"
    flush_tree(part)
    try:
        move_new(part, path)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        with locked_directory(directory, PART_PREFIX) as hidden:  # the folder of uploads may be a separate mount
            copy = hidden / id
            check_free_space(directory, part.stat().st_size)
            _copy_file(part, copy)
            flush_tree(copy)
            move_new(copy, path)
        part.unlink()
    return read_scene_file(path)


def _local_id(path: Path) -> str:
    if path.name in (META, LOD_META):
        return path.parent.name
    return path.name if path.is_dir() else scene_id(path)


def _copy(file: SceneFile, part: Path) -> None:
    first = file.files[0]
    if file.format == STREAMED:
        for path in all_files(first):
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


def display_name(source: str) -> str:
    """A source for display: a path, or a URL without user, password and query. Raises SceneNotAdded."""
    url = _split_url(source)
    return f"{url.scheme}://{url.netloc.rpartition('@')[2]}{url.path}" if url else source


def _split_url(source: str) -> SplitResult | None:
    """The parts of a URL; None for a path. Raises SceneNotAdded if the URL is invalid."""
    if "://" not in source:
        return None
    try:
        return urlsplit(source)
    except ValueError:
        raise SceneNotAdded("The scene's address is not valid.") from None


def _fetch(url: str, part: Path, listener: Listener, limit: int) -> None:
    too_large = SceneNotAdded(f"{display_name(url)} is larger than {limit / 1e9:g} GB; download it, and add the file.")
    try:
        with (
            httpx.stream("GET", url, headers=IDENTITY_ENCODING, follow_redirects=True, timeout=TIMEOUT_S) as answer,
            part.open("wb") as target,
        ):
            if answer.status_code != 200:
                raise SceneNotAdded(f"{display_name(url)} answers with {answer.status_code} {answer.reason_phrase}.")
            size = int(answer.headers.get("Content-Length") or 0)
            if size > limit:
                raise too_large
            got = 0
            patience = IdleTimeout(TIMEOUT_S, MIN_BYTES_PER_S, time.monotonic())
            for content in answer.iter_raw():  # chunks of any size: waiting for full ones would hide a trickle
                check_free_space(part.parent, max(len(content), size - got))
                got += len(content)
                if got > limit:
                    raise too_large
                if (now := time.monotonic()) > patience.expires_at:
                    raise SceneNotAdded(f"{display_name(url)} is too slow; the download was aborted.")
                patience.extend(len(content), now)
                target.write(content)
                if size:
                    listener(got / size)
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        reason = str(error).rstrip(".") or type(error).__name__
        raise SceneNotAdded(f"{display_name(url)} cannot be fetched: {reason}.") from None


def _lock_directory(directory: Path) -> AbstractContextManager[object]:
    """Serialise the changes to a directory's scenes, so that no change is lost."""
    return lock_directory(directory.resolve())


def remove_scene(directory: Path, id: str) -> None:
    """Remove a scene's file, or its folder with all contents; of a symbolic link, only the link.

    Raises UnknownScene and OSError.
    """
    with ExitStack() as after:
        with _lock_directory(directory):
            path = _path(directory, id)
            if path.is_symlink() or not path.is_dir():
                path.unlink()
                metadata_path(path).unlink(missing_ok=True)
                return
            hidden = after.enter_context(locked_directory(directory, REMOVED_PREFIX))
            path.rename(hidden / id)  # removes the scene in one step, although deleting its files may take long
        shutil.rmtree(hidden / id)


def rename_scene(directory: Path, id: str, name: str) -> None:
    """Change a scene's id by renaming its file or folder, and the name in its metadata, if any.

    Raises UnknownScene, SceneNotAdded if it cannot have the new id, and OSError.
    """
    with _lock_directory(directory):
        path = _path(directory, id)
        check_free(directory, name)
        _rename(directory, path, name)


def _rename(directory: Path, path: Path, name: str) -> None:
    before = _metadata(path)
    after = {**before, "name": name} if "name" in before else before
    if path.is_dir():
        target = directory / name
        if after != before:
            _write_metadata(path, after)
    else:
        target = directory / f"{name}{path.name.removeprefix(scene_id(path))}"
        if after != before:
            _write_metadata(target, after)
        elif metadata_path(path).exists():  # even if it is invalid
            replace_file(metadata_path(target), read_regular(metadata_path(path), MAX_METADATA))
    same = target.exists() and target.samefile(path)  # only the case changes, on a case-insensitive file system
    try:
        if same:
            path.rename(target)
        else:
            move_new(path, target)
    except OSError:
        if path.is_dir():
            if after != before:
                _write_metadata(path, before)
        elif not same:
            metadata_path(target).unlink(missing_ok=True)
        raise
    if not (same or target.is_dir()):
        metadata_path(path).unlink(missing_ok=True)


def edit_scene(directory: Path, id: str, edit: SceneEdit) -> None:
    """Change a scene's metadata.

    Raises UnknownScene, InvalidRequest if the result is invalid, BrokenScene if the metadata is already invalid, and
    OSError. Nothing is changed in these cases.
    """
    with _lock_directory(directory):
        path = _path(directory, id)
        metadata = read_metadata(path).model_dump(mode="json", exclude_unset=True)
        merged = _merge(metadata, edit.model_dump(mode="json", exclude_unset=True))
        parse(SceneMetadata, json.dumps(merged).encode(), MAX_METADATA)
        _write_metadata(path, merged)


def _merge(metadata: dict[str, Any], edit: dict[str, Any]) -> dict[str, Any]:
    saved: dict[str, Any] = {
        kind: {name: value for name, value in {**metadata.get(kind, {}), **edit[kind]}.items() if value is not None}
        for kind in ("views", "paths")
        if kind in edit
    }
    return {**metadata, **edit, **saved}


def _path(directory: Path, id: str) -> Path:
    try:
        return scene_paths(directory)[id]
    except KeyError:
        raise UnknownScene(f"There is no scene {id[:100]!r}.") from None


def _metadata(scene: Path) -> dict[str, Any]:
    """The content of a scene's metadata; empty if it is missing or invalid. Raises OSError."""
    try:
        metadata = json.loads(read_regular(metadata_path(scene), MAX_METADATA))
    except (FileNotFoundError, ValueError, RecursionError):
        return {}
    return metadata if isinstance(metadata, dict) else {}


def _write_metadata(scene: Path, metadata: dict[str, Any]) -> None:
    content = f"{json.dumps(metadata, indent=2, ensure_ascii=False)}\n"
    replace_file(metadata_path(scene), content.encode())
