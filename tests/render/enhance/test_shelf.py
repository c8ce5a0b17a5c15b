"""Weights next to scenes: offered while they fit the scene's file and the ladder, refused in a sentence otherwise."""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests.common.test_weights import NETWORK, made
from tests.not_files import NOT_FILES
from tigas_common.weights import FILE, GENERAL, MAX_BYTES, BrokenWeights, write_weights
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.enhance.shelf import NoPlace, NoWeights, Shelf
from tigas_render.scenes.demo import DEMO_SOURCE
from tigas_render.scenes.source import SceneMetadata, SceneSource


@pytest.fixture
def scene(tmp_path: Path) -> SceneSource:
    folder = tmp_path / "garden"
    folder.mkdir()
    ply = folder / "garden.ply"
    ply.write_bytes(b"as it was")
    digest = lambda: hashlib.sha256(ply.read_bytes()).hexdigest()  # noqa: E731
    return SceneSource("garden", SceneMetadata(), "1", None, digest=digest, folder=folder)


@pytest.fixture
def shelf(tmp_path: Path) -> Shelf:
    return Shelf(DEFAULT_LADDER, tmp_path / "cache", tmp_path / "general.safetensors")


def own(scene: SceneSource) -> str:
    assert scene.digest is not None
    return scene.digest()


def test_a_scene_has_its_own_weights_only_while_its_file_is_the_same(scene: SceneSource, shelf: Shelf) -> None:
    assert scene.folder is not None
    assert shelf.kind(scene) is None
    with pytest.raises(NoWeights, match="garden has no networks"):
        shelf.content(scene)
    write_weights(scene.folder / FILE, made(NETWORK, scene=own(scene)))
    assert shelf.kind(scene) == "scene"
    assert shelf.content(scene) == (scene.folder / FILE).read_bytes()
    (scene.folder / "garden.ply").write_bytes(b"as it is now")
    assert shelf.kind(scene) is None
    with pytest.raises(BrokenWeights, match="file has changed since these weights were trained"):
        shelf.content(scene)


def test_the_general_ones_serve_where_a_scenes_own_do_not(scene: SceneSource, shelf: Shelf, tmp_path: Path) -> None:
    assert scene.folder is not None
    with pytest.raises(NoWeights):
        shelf.general()
    general = replace(made(NETWORK), scene_sha256=GENERAL)
    write_weights(tmp_path / "general.safetensors", general)
    (scene.folder / FILE).write_bytes(b"no weights")
    assert shelf.kind(scene) == "general"
    assert shelf.problem(scene) == "The weights' file is no whole safetensors file."
    assert shelf.general() == (tmp_path / "general.safetensors").read_bytes()
    other_ladder = Shelf(DEFAULT_LADDER[:2], tmp_path, tmp_path / "general.safetensors")
    assert other_ladder.kind(scene) is None


def test_weights_that_are_replaced_are_read_again(scene: SceneSource, shelf: Shelf) -> None:
    assert scene.folder is not None
    (scene.folder / FILE).write_bytes(b"no weights")
    assert shelf.kind(scene) is None
    write_weights(scene.folder / FILE, made(NETWORK, scene=own(scene)))
    assert shelf.kind(scene) == "scene"


@pytest.mark.parametrize("what", [*NOT_FILES, "too large"])
def test_what_is_no_regular_file_or_too_large_is_refused(what: str, scene: SceneSource, shelf: Shelf) -> None:
    assert scene.folder is not None
    make = NOT_FILES.get(what, lambda path: path.write_bytes(bytes(MAX_BYTES + 1)))
    make(scene.folder / FILE)
    assert shelf.kind(scene) is None
    with pytest.raises(BrokenWeights, match="cannot be read"):
        shelf.content(scene)


def test_a_built_in_scenes_weights_are_kept_in_the_cache(shelf: Shelf) -> None:
    place = shelf.writable_place(DEMO_SOURCE)
    write_weights(place, made(NETWORK, scene=own(DEMO_SOURCE)))
    assert shelf.kind(DEMO_SOURCE) == "scene"


def test_a_folder_that_cannot_be_written_is_named(
    scene: SceneSource, shelf: Shelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write everywhere
    with pytest.raises(NoPlace, match="folder of garden"):
        shelf.writable_place(scene)
