"""Walking through a scene: every way to move, and the viewer's messages."""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, Request, expect

from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, changes, hold, picture, stat, wait_for_frames, wait_until_settled

ONE_RUNG = {"controller": "fixed", "profile": 0, "refine": False, "webp": False}
AS_THEY_COME = {"reprojection": False, "prediction": "off"}
"""Settings with which equal views give equal pictures, and a resting view is requested once."""


@pytest.fixture
def viewer(open_page: OpenPage) -> Page:
    """A small scene, with its first frame on the screen."""
    return with_a_frame(open_page(SCENE))


def with_a_frame(page: Page) -> Page:
    """The same, once a frame is on the screen."""
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


def test_r_goes_back_to_the_start(open_page: OpenPage, server: RenderServer) -> None:
    """The request after `r` equals the first one, to the last bit, and so does the picture.

    That holds at one rung. From this start view at High, the one at Medium-High differs by 1.26 of 255 on the mean, the
    one at Medium-Low by 2.2, and that at Low by 7.3; adaptation or refinement may have reached another at the second
    visit.
    """
    viewer = open_page(**with_settings(server.url, **ONE_RUNG, **AS_THEY_COME, transport="fetch"))
    asked: list[Any] = []

    def note(request: Request) -> None:
        if request.url.endswith("/render"):
            asked.append(request.post_data_json)

    viewer.on("request", note)
    viewer.goto(server.url + SCENE)
    with_a_frame(viewer)
    start = picture(viewer)
    assert changes(viewer, lambda: hold(viewer, "ArrowRight")) > 1
    assert changes(viewer, lambda: viewer.keyboard.press("r")) > 1
    first, *_, last = asked
    assert last == first | {"seq": last["seq"]}
    assert np.array_equal(picture(viewer), start)


def test_the_address_follows_the_camera_at_rest(open_page: OpenPage, server: RenderServer) -> None:
    page = with_a_frame(open_page(SCENE, **with_settings(server.url, **ONE_RUNG, **AS_THEY_COME)))
    start = picture(page)
    hold(page, "ArrowRight")
    page.wait_for_function("() => location.hash.includes('at=')")
    wait_until_settled(page)
    turned = picture(page)
    page.reload()
    with_a_frame(page)
    assert np.abs(picture(page) - turned).mean() < 1
    assert np.abs(turned - start).mean() > 1, "the camera stood still"


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


def test_a_lower_profile_has_fewer_pixels_and_is_refined_when_still(viewer: Page) -> None:
    expect(viewer.locator("[data-stat=profile]")).to_have_text("Refined")
    high = stat(viewer, "resolution")
    viewer.get_by_label("Sharpen when you stop").uncheck()
    viewer.get_by_label("Adaptation").select_option("fixed")
    viewer.get_by_role("radio", name="Low").last.check()
    expect(viewer.locator("[data-stat=profile]")).to_have_text("Low")
    assert int(stat(viewer, "resolution").split(" × ")[0]) < int(high.split(" × ")[0]) / 2
    viewer.get_by_label("Sharpen when you stop").check()
    expect(viewer.locator("[data-stat=profile]")).to_have_text("Refined")


def test_other_transports_carry_frames_too(viewer: Page) -> None:
    for choice, name in (("fetch", "HTTP fetch"), ("webtransport-datagrams", "WebTransport datagrams")):
        viewer.get_by_label("Transport").select_option(choice)
        expect(viewer.locator("[data-stat=transport]")).to_have_text(name)
        assert changes(viewer, lambda: hold(viewer, "ArrowRight")) > 1, name


def test_an_unknown_scene_is_one_sentence_and_a_way_back(open_page: OpenPage) -> None:
    page = open_page("#/scene/no-such-scene", expected_errors="404")
    expect(page.locator(".message")).to_contain_text("no-such-scene")
    page.get_by_role("link", name="All scenes", exact=True).click()
    expect(page.get_by_role("heading", name="Scenes")).to_be_visible()


def test_the_built_in_scene_can_be_walked_through(open_page: OpenPage) -> None:
    page = open_page("#/scene/courtyard")
    wait_for_frames(page)
    wait_until_settled(page)
    assert picture(page).std() > 10, "the picture is blank"
    assert changes(page, lambda: hold(page, "KeyW")) > 0.5
