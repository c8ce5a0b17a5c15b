"""Scenes that a visitor adds, renames and deletes on the page."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.render.scenes import made_up
from tests.web.conftest import OpenPage
from tests.web.server import RenderServer

DROP = """async ([name, content]) => {
  const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
  const data = new DataTransfer();
  data.items.add(new File([bytes], name));
  const drop = (kind) =>
    window.dispatchEvent(new DragEvent(kind, { dataTransfer: data, cancelable: true, bubbles: true }));
  drop("dragover");
  await new Promise(requestAnimationFrame);
  drop("drop");
}"""


@pytest.fixture
def dashboard(server: RenderServer, models: Path, open_page: OpenPage) -> Iterator[Page]:
    # expected failures: a broken scene's preview, a refused file, and a deleted scene
    page = open_page(expected_errors="the server responded with a status of 4")
    expect(page.get_by_role("button", name="Add scenes")).to_be_visible()
    yield page
    for left in ("shell.spz", "Sea shell.spz"):
        (models / left).unlink(missing_ok=True)


def drop(page: Page, name: str, content: bytes) -> None:
    """Let a file fall on the page."""
    page.evaluate(DROP, [name, base64.b64encode(content).decode()])


def test_a_dropped_file_becomes_a_scene_that_is_renamed_and_deleted(dashboard: Page, models: Path) -> None:
    page = dashboard
    drop(page, "shell.spz", (made_up.FILES / "shell-3.spz").read_bytes())
    card = page.locator("[data-scene=shell]")
    expect(card).to_contain_text("SPZ 3")
    expect(page.locator("[data-upload]")).to_have_count(0)

    card.get_by_role("button", name="Rename: shell").click()
    question = page.get_by_role("dialog", name="Rename “shell”")
    question.get_by_role("textbox").fill("Sea shell")
    page.keyboard.press("Enter")
    renamed = page.locator("[data-scene='Sea shell']")
    expect(renamed.get_by_role("heading", name="Sea shell")).to_be_visible()
    expect(card).to_have_count(0)

    renamed.get_by_role("button", name="Delete: Sea shell").click()
    page.get_by_role("dialog", name="Delete “Sea shell”?").get_by_role("button", name="Delete").click()
    expect(renamed).to_have_count(0)
    assert not list(models.glob("*hell*"))


def test_what_is_no_scene_says_why_until_it_is_dismissed(dashboard: Page) -> None:
    drop(dashboard, "letter.ply", b"Dear reader, " * 10)
    upload = dashboard.locator("[data-upload=failed]")
    expect(upload.get_by_role("alert")).to_contain_text("letter is not a scene")
    upload.get_by_role("button", name="Dismiss: letter.ply").click()
    expect(upload).to_have_count(0)
