"""ladder.json: a scene's own ladder, and the sentence for an invalid one, which does not affect the scene."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest

from tests.not_files import NOT_FILES
from tests.render.scenes import plys
from tests.render.scenes.registry_bench import Bench
from tigas_common.errors import BrokenScene
from tigas_render.scenes.directory import read_source
from tigas_render.scenes.source import read_ladder

GOOD = [
    {"name": "1280×720 q80", "width": 1280, "height": 720, "quality": 80, "expected_kb": 160.0, "psnr_db": 37.5},
    {"name": "480×270 q50", "width": 480, "height": 270, "quality": 50, "expected_kb": 14, "psnr_db": 27},
]


def content(*changes: dict[str, object]) -> bytes:
    """Of a ladder.json, its rungs changed."""
    rungs = [rung | change for rung, change in zip(GOOD, (*changes, {}, {}), strict=False)]
    return json.dumps({"rungs": rungs}).encode()


def folder_with(tmp_path: Path, ladder: bytes) -> Path:
    plys.write(tmp_path / "hall" / "scene.ply", plys.binary_ply())
    plys.write(tmp_path / "hall" / "ladder.json", ladder)
    return tmp_path / "hall"


def test_a_scene_without_a_ladder_has_none(tmp_path: Path) -> None:
    assert read_ladder(tmp_path) is None


@pytest.mark.anyio
async def test_a_scene_is_offered_with_its_own_ladder_unless_nobody_wants_them(tmp_path: Path) -> None:
    folder_with(tmp_path, content())
    registry = Bench(budget=10_000_000).registry(tmp_path)
    await registry.scan()
    ladder = registry.info("hall").ladder
    assert ladder is not None
    assert [(rung.name, rung.quality, rung.psnr_db) for rung in ladder] == [
        ("1280×720 q80", 80, 37.5),
        ("480×270 q50", 50, 27),
    ]
    async with registry.use("hall") as scene:
        assert scene.ladder == ladder
    plain = Bench(budget=10_000_000).registry(tmp_path, own_ladders=False)
    await plain.scan()
    assert plain.info("hall").ladder is None


@pytest.mark.parametrize(
    ("ladder", "words"),
    [
        (b"", "JSON"),
        (b"[]", "object"),
        (b"{}", "rungs"),
        (b'{"rungs": []}', "at least 1"),
        (json.dumps({"rungs": GOOD, "rugns": 1}).encode(), "rugns"),
        (
            json.dumps({"rungs": [{**GOOD[0], "name": f"{i}", "expected_kb": 100 - i} for i in range(17)]}).encode(),
            "16",
        ),
        (content({"quality": 101}), "quality"),
        (content({"expected_kb": 0}), "expected_kb"),
        (content({"expected_kb": float("nan")}), "expected_kb"),
        (content({"width": 8193}), "width"),
        (content({}, {"name": "1280×720 q80"}), "same name"),
        (content({}, {"expected_kb": 160}), "smaller frames"),
        (content({}, {"psnr_db": 40}), "cannot be better"),
        (b" " * 20_000, "larger than 16 KiB"),
    ],
)
def test_anything_else_is_refused_with_a_sentence_and_the_scene_stays(
    tmp_path: Path, ladder: bytes, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    folder = folder_with(tmp_path, ladder)
    with pytest.raises(BrokenScene, match=words) as failure:
        read_ladder(folder)
    assert failure.value.detail.startswith("ladder.json ")
    assert failure.value.detail.endswith(".")
    with caplog.at_level(logging.WARNING):
        source = read_source(folder)
    assert (source.error, source.ladder) == (None, None)
    assert failure.value.detail in caplog.text


@pytest.mark.parametrize("kind", NOT_FILES)
def test_what_is_no_file_costs_nobody_the_scene(tmp_path: Path, kind: str) -> None:
    plys.write(tmp_path / "scene.ply", plys.binary_ply())
    NOT_FILES[kind](tmp_path / "ladder.json")
    source = read_source(tmp_path)
    assert (source.error, source.ladder) == (None, None)
