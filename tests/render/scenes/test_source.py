"""scene.json and ladder.json: valid contents, and the sentences for invalid ones."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest

from tests.render.scenes import plys
from tests.render.scenes.registry_bench import Bench
from tigas_common.errors import BrokenScene
from tigas_common.wire.render import StartCamera
from tigas_render.scenes.directory import read_source
from tigas_render.scenes.source import SceneMetadata, read_ladder, read_metadata

RUNGS = [
    {"name": "1280×720 q80", "width": 1280, "height": 720, "quality": 80, "expected_kb": 160.0, "psnr_db": 37.5},
    {"name": "480×270 q50", "width": 480, "height": 270, "quality": 50, "expected_kb": 14, "psnr_db": 27},
]
MANY = [{**RUNGS[0], "name": f"{number}", "expected_kb": 100 - number} for number in range(17)]


def ladder(*changes: dict[str, object]) -> bytes:
    """The content of a ladder.json, its rungs changed."""
    rungs = [rung | change for rung, change in zip(RUNGS, (*changes, {}, {}), strict=False)]
    return json.dumps({"rungs": rungs}).encode()


def folder_with(tmp_path: Path, name: str, content: bytes) -> Path:
    """A scene's folder with another file."""
    plys.write(tmp_path / "hall" / "scene.ply", plys.binary_ply())
    return plys.write(tmp_path / "hall" / name, content).parent


def test_all_metadata_may_be_said_or_left_out(tmp_path: Path) -> None:
    assert read_metadata(tmp_path) == SceneMetadata()
    assert read_metadata(folder_with(tmp_path, "scene.json", b"{}")) == SceneMetadata()
    content = (
        b'{"name": "Garden", "up": [0, 0, 1], "background": [1, 0.5, 0],'
        b' "camera": {"position": [1, 2, 3], "look_at": [0, 0, 0]}}'
    )
    assert read_metadata(folder_with(tmp_path, "scene.json", content)) == SceneMetadata(
        name="Garden",
        up=(0, 0, 1),
        background=(1, 0.5, 0),
        camera=StartCamera(position=(1, 2, 3), look_at=(0, 0, 0)),
    )


@pytest.mark.anyio
async def test_a_scene_is_offered_with_its_own_ladder_unless_nobody_wants_them(tmp_path: Path) -> None:
    assert read_ladder(tmp_path) is None
    folder_with(tmp_path, "ladder.json", ladder())
    registry = Bench(budget=10_000_000).registry(tmp_path)
    await registry.scan()
    own = registry.scene_info("hall").ladder
    assert own is not None
    assert [(rung.name, rung.quality, rung.psnr_db) for rung in own] == [
        ("1280×720 q80", 80, 37.5),
        ("480×270 q50", 50, 27),
    ]
    async with registry.use("hall") as scene:
        assert scene.ladder == own
    plain = Bench(budget=10_000_000).registry(tmp_path, own_ladders=False)
    await plain.scan()
    assert plain.scene_info("hall").ladder is None


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("scene.json", b"", "JSON"),
        ("scene.json", b"\xff\xfe", "JSON"),
        ("scene.json", b"[]", "object"),
        ("scene.json", b'{"nmae": "Garden"}', "nmae"),
        ("scene.json", b'{"name": ""}', "name"),
        ("scene.json", b'{"up": [0, 0, 0]}', "length zero"),
        ("scene.json", b'{"up": [0, 0, 1e-200]}', "length zero"),
        ("scene.json", b'{"up": [0, 1]}', "up"),
        ("scene.json", b'{"background": [255, 0, 0]}', "background.0"),
        ("scene.json", b'{"camera": {"position": [0, 0, 0], "look_at": [0, 0, 0]}}', "its own position"),
        ("scene.json", b'{"camera": {"position": [0, 0, NaN], "look_at": [0, 0, 0]}}', "camera.position.2"),
        ("scene.json", b'{"camera": {"position": [0, 0, 0]}}', "look_at"),
        ("scene.json", b" " * 2_000_000, "larger than 1024 KiB"),
        ("ladder.json", b"", "JSON"),
        ("ladder.json", b"[]", "object"),
        ("ladder.json", b"{}", "rungs"),
        ("ladder.json", b'{"rungs": []}', "at least 1"),
        ("ladder.json", json.dumps({"rungs": RUNGS, "rugns": 1}).encode(), "rugns"),
        ("ladder.json", json.dumps({"rungs": MANY}).encode(), "16"),
        ("ladder.json", ladder({"quality": 101}), "quality"),
        ("ladder.json", ladder({"expected_kb": 0}), "expected_kb"),
        ("ladder.json", ladder({"expected_kb": float("nan")}), "expected_kb"),
        ("ladder.json", ladder({"width": 8193}), "width"),
        ("ladder.json", ladder({}, {"name": "1280×720 q80"}), "same name"),
        ("ladder.json", ladder({}, {"expected_kb": 160}), "smaller frames"),
        ("ladder.json", ladder({}, {"psnr_db": 40}), "cannot be better"),
        ("ladder.json", b" " * 2_000_000, "larger than 1024 KiB"),
    ],
)
def test_anything_else_is_a_sentence_which_breaks_the_scene_unless_it_is_about_its_ladder(
    tmp_path: Path, name: str, content: bytes, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    folder = folder_with(tmp_path, name, content)
    with pytest.raises(BrokenScene, match=words) as failure:
        (read_metadata if name == "scene.json" else read_ladder)(folder)
    detail = failure.value.detail
    assert detail.startswith(f"{name} ")
    assert detail.endswith(".")
    with caplog.at_level(logging.WARNING):
        source = read_source(folder)
    if name == "scene.json":
        assert source.error == detail
    else:
        assert (source.error, source.ladder) == (None, None)
        assert detail in caplog.text
