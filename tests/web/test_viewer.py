"""Walking through a scene: every way to move, and the viewer's messages."""

from __future__ import annotations

from functools import partial
from typing import Literal

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.stage import SCENE, changes, hold, picture, stat, wait_for_frames, wait_until_settled


@pytest.fixture
def viewer(open_page: OpenPage) -> Page:
    """A small scene, with its first frame on the screen."""
    page = open_page(SCENE)
    wait_for_frames(page)
    wait_until_settled(page)
    return page


def test_shows_the_scene_over_webtransport(viewer: Page) -> None:
    assert picture(viewer).std() > 10, "the picture is blank"
    assert stat(viewer, "transport") == "WebTransport streams"
    assert viewer.locator(".stage").get_attribute("data-transport") == "webtransport-streams"


def test_saves_a_picture_of_the_view_without_loss(viewer: Page) -> None:
    shown = picture(viewer)
    with viewer.expect_download() as download:
        viewer.keyboard.press("t")
    with Image.open(download.value.path()) as image:
        box = viewer.locator(".stage").bounding_box()
        assert box is not None
        assert (image.format, image.size) == ("PNG", (round(box["width"]), round(box["height"])))
        width, height = image.size
        part = image.convert("RGB").crop((width * 52 // 100, height * 30 // 100, width * 92 // 100, height * 65 // 100))
        saved = np.asarray(part.resize((shown.shape[1], shown.shape[0])), dtype=np.int16)
    assert np.abs(saved - shown).mean() < 5
    assert download.value.suggested_filename == "Pebbles.png"


def test_keys_move_the_camera(viewer: Page) -> None:
    for key in ("KeyW", "KeyS", "KeyA", "KeyD", "Space", "ShiftLeft", "ArrowLeft", "ArrowUp"):
        assert changes(viewer, partial(hold, viewer, key, views=2)) > 1, key


def test_dragging_turns_pans_or_orbits_and_the_wheel_walks(viewer: Page) -> None:
    def drag(button: Literal["left", "right"] = "left") -> None:
        viewer.mouse.move(500, 300)
        viewer.mouse.down(button=button)
        viewer.mouse.move(420, 330, steps=4)
        viewer.mouse.up(button=button)

    assert changes(viewer, drag) > 1
    assert changes(viewer, lambda: drag("right")) > 1
    assert changes(viewer, lambda: viewer.mouse.dblclick(500, 200)) > 1
    viewer.keyboard.press("o")
    assert changes(viewer, drag) > 1
    assert changes(viewer, lambda: viewer.mouse.wheel(0, -300)) > 1


def test_the_hud_measures(viewer: Page) -> None:
    viewer.keyboard.down("ArrowRight")
    viewer.wait_for_function("() => Number(document.querySelector('[data-stat=new-views]').textContent) > 1")
    viewer.wait_for_function("() => parseFloat(document.querySelector('[data-stat=motion-to-photon]').textContent) > 5")
    viewer.keyboard.up("ArrowRight")
    assert float(stat(viewer, "round-trip").split()[0]) > 0
    assert float(stat(viewer, "server").split()[0]) > 0
    expect(viewer.locator("[data-stat=profile]")).to_have_text("Refined")  # as it stands still
    assert "kB" in stat(viewer, "frame")
    viewer.keyboard.press("i")
    expect(viewer.locator(".hud")).to_have_count(0)


def test_other_transports_carry_frames_too(viewer: Page) -> None:
    for choice, name in (("fetch", "HTTP fetch"), ("webtransport-datagrams", "WebTransport datagrams")):
        viewer.get_by_label("Transport").select_option(choice)
        expect(viewer.locator("[data-stat=transport]")).to_have_text(name)
        assert changes(viewer, lambda: hold(viewer, "ArrowRight")) > 1, name


def test_the_built_in_scene_can_be_walked_through(open_page: OpenPage) -> None:
    page = open_page("#/scene/courtyard")
    wait_for_frames(page)
    wait_until_settled(page)
    assert picture(page).std() > 10, "the picture is blank"
    assert changes(page, lambda: hold(page, "KeyW")) > 0.5
