"""The list of scenes, as a visitor sees it."""

from __future__ import annotations

from playwright.sync_api import expect

from tests.web.conftest import OpenPage


def test_shows_each_scene_with_its_picture(open_page: OpenPage) -> None:
    page = open_page()
    card = page.locator("[data-scene=pebbles]")
    expect(card.get_by_role("heading", name="Pebbles")).to_be_visible()
    expect(card.locator(".thumbnail")).to_have_attribute("data-state", "there")
    assert card.locator("img").evaluate("image => image.naturalWidth") > 100


def test_links_reloading_and_the_back_button_work(open_page: OpenPage) -> None:
    page = open_page()
    page.get_by_role("link", name="Pebbles").click()
    expect(page.get_by_role("heading", name="Pebbles")).to_be_visible()
    page.reload()
    expect(page.locator(".stage")).to_be_visible()
    page.go_back()
    expect(page.get_by_role("heading", name="Scenes")).to_be_visible()
