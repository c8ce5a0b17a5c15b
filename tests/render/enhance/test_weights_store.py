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
from tigas_render.enhance.weights_store import NoWeights, ReadOnlyScene, WeightsStore
from tigas_render.scenes.demo import DEMO_SOURCE
from tigas_render.scenes.source import SceneMetadata, SceneSource


@pytest.fixture
def ply(tmp_path: Path) -> Path:
    ply = tmp_path / "garden" / "garden.ply"
    ply.parent.mkdir()
    ply.write_bytes(b"as it was")
    return ply


@pytest.fixture
def scene(ply: Path) -> SceneSource:
    digest = lambda: hashlib.sha256(ply.read_bytes()).hexdigest()  # noqa: E731
    return SceneSource("garden", SceneMetadata(), "1", None, digest=digest, folder=ply.parent)


@pytest.fixture
def store(tmp_path: Path) -> WeightsStore:
    return WeightsStore(DEFAULT_LADDER, tmp_path / "cache", tmp_path / "general.safetensors")


def train(scene: SceneSource, store: WeightsStore) -> Path:
    """Write a scene's own weights."""
    assert scene.digest is not None
    file = store.writable_path(scene)
    write_weights(file, made(NETWORK, scene=scene.digest()))
    return file


def test_weights_belong_to_the_scenes_file(scene: SceneSource, store: WeightsStore, ply: Path) -> None:
    assert store.kind(scene) is None
    with pytest.raises(NoWeights, match="garden has no networks"):
        store.read(scene)
    file = train(scene, store)
    assert store.kind(scene) == "scene"
    assert store.read(scene) == file.read_bytes() == (ply.parent / FILE).read_bytes()
    ply.write_bytes(b"as it is now")
    assert store.kind(scene) is None
    with pytest.raises(BrokenWeights, match="file has changed since these weights were trained"):
        store.read(scene)


def test_the_general_ones_serve_where_a_scenes_own_do_not(
    scene: SceneSource, store: WeightsStore, tmp_path: Path
) -> None:
    with pytest.raises(NoWeights):
        store.read_general()
    file = tmp_path / "general.safetensors"
    write_weights(file, replace(made(NETWORK), scene_sha256=GENERAL))
    store.path(scene).write_bytes(b"no weights")
    assert store.kind(scene) == "general"
    assert store.problem(scene) == "The weights are not a complete safetensors file."
    assert store.read_general() == file.read_bytes()
    assert WeightsStore(DEFAULT_LADDER[:2], tmp_path, file).kind(scene) is None, "another ladder"
    train(scene, store)
    assert store.kind(scene) == "scene", "a file that is replaced is read again"


@pytest.mark.parametrize("what", [*NOT_FILES, "too large"])
def test_what_is_no_regular_file_or_too_large_is_refused(what: str, scene: SceneSource, store: WeightsStore) -> None:
    make = NOT_FILES.get(what, lambda path: path.write_bytes(bytes(MAX_BYTES + 1)))
    make(store.path(scene))
    assert store.kind(scene) is None
    with pytest.raises(BrokenWeights, match="cannot be read"):
        store.read(scene)


def test_a_built_in_scenes_weights_are_kept_in_the_cache(store: WeightsStore) -> None:
    train(DEMO_SOURCE, store)
    assert store.kind(DEMO_SOURCE) == "scene"


def test_a_read_only_folder_is_named(scene: SceneSource, store: WeightsStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write everywhere
    with pytest.raises(ReadOnlyScene, match="folder of garden"):
        store.writable_path(scene)
