"""The list of scenes, as a visitor sees it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.server import RenderServer


def test_shows_each_scene_with_its_picture(open_page: OpenPage) -> None:
    page = open_page()
    card = page.locator("[data-scene=pebbles]")
    expect(card.get_by_role("heading", name="Pebbles")).to_be_visible()
    expect(card.locator(".thumbnail")).to_have_attribute("data-state", "there")
    assert card.locator("img").evaluate("image => image.naturalWidth") > 100


@pytest.fixture
def dashboard_with_more(open_page: OpenPage, models: Path) -> Iterator[Page]:
    """The list after a scene was added and not viewed."""
    page = open_page(expected_errors="422")  # the broken scene's preview is requested again
    expect(page.get_by_role("status")).to_have_text("3 scenes on this server")
    shutil.copytree(models / "pebbles", models / "more-pebbles")
    try:
        page.get_by_role("button", name="Rescan folder").click()
        expect(page.get_by_role("status")).to_contain_text("New: Pebbles.")
        expect(page.locator("[data-scene=more-pebbles] .thumbnail")).to_have_attribute("data-state", "there")
        yield page
    finally:
        shutil.rmtree(models / "more-pebbles")
        page.get_by_role("button", name="Rescan folder").click()
        expect(page.locator(".card")).to_have_count(3)


def test_new_scenes_are_found_when_asked_for_loaded_and_unloaded(
    dashboard_with_more: Page, server: RenderServer
) -> None:
    page = dashboard_with_more
    page.request.post(f"{server.url}scenes/more-pebbles/unload")
    page.reload()
    card = page.locator("[data-scene=more-pebbles]")
    expect(card).to_have_attribute("data-state", "unloaded")
    card.get_by_role("button", name="Load: Pebbles").click()
    expect(card).to_have_attribute("data-state", "loaded")
    expect(card).to_contain_text("2 k Gaussians")
    card.get_by_role("button", name="Unload: Pebbles").click()
    expect(card).to_have_attribute("data-state", "unloaded")


def test_links_reloading_and_the_back_button_work(open_page: OpenPage) -> None:
    page = open_page()
    page.get_by_role("link", name="Pebbles").click()
    expect(page.get_by_role("heading", name="Pebbles")).to_be_visible()
    page.reload()
    expect(page.locator(".stage")).to_be_visible()
    page.go_back()
    expect(page.get_by_role("heading", name="Scenes")).to_be_visible()
