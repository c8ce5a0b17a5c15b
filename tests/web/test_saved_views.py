"""Views and camera paths that a visitor saves with the scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.movements import Poses, opened, press, wait_for_pose
from tests.web.scenes import SMALL
from tests.web.server import RenderServer
from tests.web.stage import hold, wait_for_frames, wait_until_settled


@pytest.fixture
def visit(server: RenderServer, models: Path, open_page: OpenPage) -> Iterator[tuple[Page, Poses]]:
    """A viewer with open settings; changes of the scene are undone afterwards."""
    description = models / SMALL / "scene.json"
    before = description.read_text()
    yield opened(open_page, server.url)
    description.write_text(before)
    urlopen(f"{server.url}scenes?scan=1").close()


def walk(page: Page, poses: Poses, key: str) -> tuple[float, float, float]:
    """Hold a key for some views; where the camera is then."""
    page.locator(".stage").focus()
    hold(page, key)
    wait_until_settled(page)
    x, y, z = poses.positions[-1]
    return x, y, z


def test_a_view_and_a_path_are_saved_and_there_after_a_reload(visit: tuple[Page, Poses]) -> None:
    page, poses = visit
    corner = walk(page, poses, "KeyD")
    page.get_by_label("Name", exact=True).fill("Corner")
    press(page, "Save this view")
    expect(page.get_by_role("button", name="Corner", exact=True)).to_be_visible()

    press(page, "Add this view as a keyframe")
    door = walk(page, poses, "KeyW")
    assert np.linalg.norm(np.subtract(door, corner)) > 0.1
    press(page, "Add this view as a keyframe")
    page.get_by_label("Path name").fill("Way in")
    press(page, "Save path")
    expect(page.get_by_role("radio", name="Way in")).to_be_checked()

    page.reload()
    wait_for_frames(page)
    press(page, "Corner")
    wait_for_pose(page, poses, corner)
    page.get_by_role("radio", name="Way in").check()
    page.get_by_label("Duration").fill("60")
    page.keyboard.press("Enter")
    press(page, "Play path")
    press(page, "Stop path")
    page.get_by_label("Duration").fill("2")
    page.keyboard.press("Enter")
    poses.clear()
    press(page, "Play path")
    wait_for_pose(page, poses, door)
    expect(page.get_by_role("button", name="Play path", exact=True)).to_be_visible()
    along = (poses.positions - corner) @ np.subtract(door, corner)
    assert len(np.unique(along)) > 2, "the camera jumped"
