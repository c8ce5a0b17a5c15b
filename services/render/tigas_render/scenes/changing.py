"""Renames and removes scenes of a models directory. A name is looked up there, so that none leads elsewhere."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

from tigas_common.errors import UnknownScene
from tigas_common.files import read_regular
from tigas_common.parsing import MAX_BODY
from tigas_render.scenes.adding import check_free
from tigas_render.scenes.directory import scene_id, scene_paths

METADATA = "scene.json"


def remove_scene(directory: Path, id: str) -> None:
    """Remove a scene's file, or its folder with all that is in it; of a link, the link alone.

    Raises UnknownScene and OSError.
    """
    path = _path(directory, id)
    if path.is_symlink() or not path.is_dir():
        path.unlink()
        return
    last = Path(tempfile.mkdtemp(prefix=".removed-", dir=directory))
    path.rename(last / id)  # gone in one step, however long the rest takes
    shutil.rmtree(last)


def rename_scene(directory: Path, id: str, name: str) -> None:
    """Give a scene another id: its file, or its folder, another name. A scene.json that names it gets the new one, too.

    Raises UnknownScene, NotAdded if there cannot be such a scene, and OSError.
    """
    path = _path(directory, id)
    check_free(directory, name)
    if path.is_dir():
        _rename_in_metadata(path / METADATA, name)
        path.rename(directory / name)
    else:
        target = directory / f"{name}{path.name.removeprefix(scene_id(path))}"
        target.open("x").close()  # so that it goes over no file that came meanwhile
        path.rename(target)


def _path(directory: Path, id: str) -> Path:
    try:
        return scene_paths(directory)[id]
    except KeyError:
        raise UnknownScene(f"There is no scene {id[:100]!r}.") from None


def _rename_in_metadata(file: Path, name: str) -> None:
    try:
        metadata = json.loads(read_regular(file, MAX_BODY))
    except (FileNotFoundError, ValueError):  # it says nothing, or nothing that is understood
        return
    if isinstance(metadata, dict) and "name" in metadata:
        part = file.with_name(f".{file.name}.part")
        part.write_text(json.dumps({**metadata, "name": name}, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        part.replace(file)
