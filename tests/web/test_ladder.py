"""A scene's own ladder in the page: its rungs are chosen from, and the server's once it shows the scene with that."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.prerequisites import BUILT_PAGE
from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.scenes import SMALL, write_scenes
from tests.web.server import RenderServer
from tests.web.stage import SCENE, wait_for_frames

OWN = [
    {"name": f"{16 * n}×{9 * n} q50", "width": 16 * n, "height": 9 * n, "quality": 50, "expected_kb": n, "psnr_db": n}
    for n in range(20, 11, -1)
]


@pytest.fixture
def server(tmp_path: Path) -> RenderServer:
    """Not started yet."""
    BUILT_PAGE.require()
    write_scenes(tmp_path)
    (tmp_path / SMALL / "ladder.json").write_text(json.dumps({"rungs": OWN}))
    return RenderServer("--scenes", str(tmp_path))


@pytest.mark.extended
def test_the_scenes_rungs_are_chosen_from_and_the_papers_when_the_server_comes_back_with_them(
    open_page: OpenPage, server: RenderServer
) -> None:
    chosen = {"controller": "fixed", "profile": 8, "refine": False, "hudDetails": True, "sidebar": True}
    with server:
        page = open_page(SCENE, url=server.url, expected_errors="ERR_", **with_settings(server.url, **chosen))
        wait_for_frames(page)
        expect(page.locator(".rungs label")).to_have_count(9)
        expect(page.locator("[data-stat=profile]")).to_have_text("192×108 q50")
        server.stop()
        server.extend("--ladder", "paper")
        server.start()
        page.keyboard.down("ArrowRight")
        expect(page.locator("[data-stat=profile]")).to_have_text("Low")
        expect(page.locator(".rungs label")).to_have_count(4)
