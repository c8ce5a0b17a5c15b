"""Phones, dark rooms, and keyboard users."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Page, ViewportSize, expect

from tests.web.conftest import OpenPage
from tests.web.stage import SCENE, changes, expect_apart, resize, wait_for_frames, wait_until_settled

PHONE: dict[str, Any] = {
    "viewport": {"width": 390, "height": 844},
    "device_scale_factor": 2,
    "is_mobile": True,
    "has_touch": True,
}

CONTROLS = "a[href], button, input, select, textarea, [tabindex='0']"
# Reachable elements without a name: visible, enabled, and with no label, aria-label or text.
NAMELESS = """(controls) => controls
    .filter((control) => control.checkVisibility() && !control.matches(':disabled'))
    .filter((control) => !(control.getAttribute('aria-label') || control.labels?.[0]?.innerText || control.innerText))
    .map((control) => control.outerHTML)"""
REACHABLE = """(controls) => controls
    .filter((control) => control.checkVisibility() && !control.matches(':disabled'))
    // of a group of radio buttons, Tab reaches the chosen one
    .filter((control) => control.type !== 'radio' || control.checked)
    .map((control) => control.outerHTML.slice(0, 80)).sort()"""


def touch(page: Page, *moments: list[tuple[int, int]]) -> None:
    """Fingers that go down at the first moment's places, move through the others, and lift."""
    client = page.context.new_cdp_session(page)
    for i, moment in enumerate(moments):
        points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(moment)]
        client.send("Input.dispatchTouchEvent", {"type": "touchMove" if i else "touchStart", "touchPoints": points})
    client.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    client.detach()


def test_a_phone_shows_everything_without_scrolling_sideways(open_page: OpenPage) -> None:
    page = open_page(**PHONE)
    expect(page.locator("[data-scene=pebbles]")).to_be_visible()
    for width in (390, 360):
        resize(page, {"width": width, "height": 780})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.get_by_role("link", name="Pebbles").tap()
    wait_for_frames(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    expect(page.locator(".sidebar")).to_have_count(0)
    expect(page.locator(".pad")).to_be_visible()
    page.get_by_role("button", name="Lab", exact=True).tap()
    expect(page.locator(".sidebar")).to_be_in_viewport()
    # a tablet in portrait and landscape, and a phone in landscape
    for width, height in (1024, 768), (768, 1024), (844, 390):
        resize(page, {"width": width, "height": height})
        assert page.evaluate("document.documentElement.scrollHeight") <= height
        expect_apart(page.locator(".title, [role=toolbar], .hud, .status-line, .pad, .rise"))
    page.get_by_role("button", name="Close lab").tap()
    page.evaluate("tigas.settings({ hudDetails: true })")
    for width, height in (360, 640), (640, 360), (390, 844), (844, 390):
        resize(page, {"width": width, "height": height})
        expect_apart(page.locator(".title, [role=toolbar], .hud, .status-line, .pad, .rise"))
        assert page.locator("h1").evaluate("title => title.scrollWidth <= title.clientWidth"), "the title is cut"


@pytest.mark.parametrize("compared", ["", "?left=stateless&right=video"])
def test_a_phone_shows_pictures_rather_than_figures(open_page: OpenPage, compared: str) -> None:
    page = open_page(SCENE + compared, **PHONE)
    floating = page.locator(".hud, .side-hud, .status-line, .title, [role=toolbar], .pad, .rise")
    sizes: list[ViewportSize] = [{"width": 390, "height": 844}, {"width": 844, "height": 390}]
    for size in sizes:
        resize(page, size)
        expect(page.locator("[data-stat=status]")).to_have_count(2 if compared else 1)
        expect(page.locator(".sidebar")).to_have_count(0)
        expect_apart(floating)
        areas = floating.evaluate_all("parts => parts.map((part) => part.clientWidth * part.clientHeight)")
        assert sum(areas) < 0.4 * size["width"] * size["height"]
    page.get_by_role("button", name="Lab", exact=True).tap()
    page.get_by_role("button", name="More measurements").first.tap()
    page.get_by_role("button", name="Close lab").tap()
    expect(page.locator(".hud-details")).to_have_count(2 if compared else 1)
    for size in reversed(sizes):
        resize(page, size)
        expect_apart(floating)


def test_fingers_look_around_pinch_and_walk(open_page: OpenPage) -> None:
    page = open_page(SCENE, **PHONE)
    wait_for_frames(page)
    wait_until_settled(page)
    assert changes(page, lambda: touch(page, [(200, 400)], [(150, 420)], [(100, 440)])) > 1
    assert changes(page, lambda: touch(page, [(180, 400), (220, 400)], [(100, 400), (300, 400)])) > 1
    pad = page.locator(".pad").bounding_box()
    assert pad is not None
    middle, top = (int(pad["x"] + pad["width"] / 2), int(pad["y"] + pad["height"] / 2)), int(pad["y"] + 5)
    assert changes(page, lambda: touch(page, [middle], *[[(middle[0], top)]] * 20)) > 0.5


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_follows_the_systems_colours_until_told_otherwise(open_page: OpenPage, scheme: str) -> None:
    page = open_page(color_scheme=scheme)

    def dark() -> bool:
        background = page.evaluate("getComputedStyle(document.body).backgroundColor")
        return sum(int(part) for part in background.removeprefix("rgb(").rstrip(")").split(",")) < 3 * 128

    theme = page.get_by_role("button", name="Theme")
    expect(theme).to_have_accessible_name("Theme: system")
    assert dark() == (scheme == "dark")
    theme.click()
    expect(theme).to_have_accessible_name("Theme: light")
    assert not dark()
    theme.click()
    assert dark()
    page.reload()
    expect(theme).to_have_accessible_name("Theme: dark")
    assert dark(), "the choice outlasts a reload"


@pytest.mark.parametrize("path", ["", SCENE])
def test_every_control_has_a_name_and_the_tab_key_reaches_it(open_page: OpenPage, path: str) -> None:
    page = open_page(path)
    if path:
        wait_for_frames(page)
        expect(page.get_by_role("heading", name="Lens")).to_be_visible()
    else:
        page.wait_for_selector(".card[data-scene]")
    controls = page.locator(CONTROLS)
    assert controls.evaluate_all(NAMELESS) == []
    expected = controls.evaluate_all(REACHABLE)
    page.evaluate("document.activeElement?.blur()")
    reached = set()
    for _ in range(len(expected) + 2):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.outerHTML.slice(0, 80)"))
    assert set(expected) <= reached


def test_the_focus_can_be_seen(open_page: OpenPage) -> None:
    page = open_page()
    expect(page.locator("[data-scene=pebbles]")).to_be_visible()
    page.keyboard.press("Tab")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"


def test_a_person_who_wants_no_motion_gets_none(open_page: OpenPage) -> None:
    page = open_page(reduced_motion="reduce")
    expect(page.locator("[data-scene=pebbles]")).to_be_visible()
    assert page.evaluate("document.getAnimations().length") == 0
