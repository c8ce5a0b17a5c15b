"""scene.json: valid contents, and the sentences for invalid ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.render.scenes import plys
from tigas_common.errors import BrokenScene
from tigas_common.wire.render import StartCamera
from tigas_render.scenes.directory import read_source
from tigas_render.scenes.source import SceneMetadata, read_metadata


def test_everything_may_be_said_or_left_out(tmp_path: Path) -> None:
    assert read_metadata(tmp_path) == SceneMetadata()
    assert read_metadata(plys.write(tmp_path / "scene.json", b"{}").parent) == SceneMetadata()
    content = (
        b'{"name": "Garden", "up": [0, 0, 1], "background": [1, 0.5, 0],'
        b' "camera": {"position": [1, 2, 3], "look_at": [0, 0, 0]}}'
    )
    assert read_metadata(plys.write(tmp_path / "scene.json", content).parent) == SceneMetadata(
        name="Garden",
        up=(0, 0, 1),
        background=(1, 0.5, 0),
        camera=StartCamera(position=(1, 2, 3), look_at=(0, 0, 0)),
    )


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "JSON"),
        (b"\xff\xfe", "JSON"),
        (b"[]", "object"),
        (b'{"nmae": "Garden"}', "nmae"),
        (b'{"name": ""}', "name"),
        (b'{"up": [0, 0, 0]}', "length zero"),
        (b'{"up": [0, 0, 1e-200]}', "length zero"),
        (b'{"up": [0, 1]}', "up"),
        (b'{"background": [255, 0, 0]}', "background.0"),
        (b'{"camera": {"position": [0, 0, 0], "look_at": [0, 0, 0]}}', "its own position"),
        (b'{"camera": {"position": [0, 0, NaN], "look_at": [0, 0, 0]}}', "camera.position.2"),
        (b'{"camera": {"position": [0, 0, 0]}}', "look_at"),
        (b" " * 20_000, "larger than 16 KiB"),
    ],
)
def test_anything_else_is_refused_with_a_sentence(tmp_path: Path, content: bytes, words: str) -> None:
    plys.write(tmp_path / "scene.ply", plys.binary_ply())
    path = plys.write(tmp_path / "scene.json", content)
    with pytest.raises(BrokenScene, match=words) as failure:
        read_metadata(path.parent)
    assert failure.value.detail.startswith("scene.json ")
    assert failure.value.detail.endswith(".")
    assert read_source(tmp_path).error == failure.value.detail  # the scene is listed as broken
