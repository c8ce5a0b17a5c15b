"""The mode Video: one frame of a video per pose, decoded by Chromium; and messages where that is impossible."""

from __future__ import annotations

from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, frames, picture, stat, wait_for_frames, wait_until_settled

PLAIN = {"sidebar": False, "refine": False, "reprojection": False, "prediction": "off", "hudDetails": True}
SMALL = {"width": 480, "height": 270}
ALIKE = 12
"""Two pictures of one view, encoded differently, differ by less (0 to 255)."""


def test_a_walk_as_a_video_shows_what_single_pictures_show(open_page: OpenPage, server: RenderServer) -> None:
    chosen = with_settings(server.url, mode="video", controller="fixed", profile=2, **PLAIN)
    page = open_page(SCENE, viewport=SMALL, **chosen)
    walk(page)
    first_size = stat(page, "resolution")
    assert "bit/s" in stat(page, "bitrate")
    assert 0 < int(stat(page, "key-frames")) < frames(page), "most frames refer to the one before them"

    page.evaluate("tigas.settings({ profile: 3 })")  # another size in mid-stream
    walk(page)
    expect(page.locator("[data-stat=resolution]")).not_to_have_text(first_size)

    page.evaluate("tigas.settings({ profile: 0 })")
    walk(page)
    video = picture(page)
    page.evaluate("tigas.settings({ mode: 'stateless' })")
    expect(page.locator("[data-stat=bitrate]")).to_have_count(0)
    wait_until_settled(page)
    assert abs(picture(page) - video).mean() < ALIKE


def test_without_a_decoder_one_sentence_says_so_and_other_modes_work(open_page: OpenPage, server: RenderServer) -> None:
    page = open_page("", viewport=SMALL, **with_settings(server.url, mode="video", **PLAIN))
    page.add_init_script("delete window.VideoDecoder")
    page.goto(server.url + SCENE)
    page.reload()
    expect(page.locator(".stage-message")).to_contain_text("This browser has no WebCodecs")
    assert frames(page) == 0
    page.evaluate("tigas.settings({ mode: 'stateless' })")
    wait_for_frames(page)
    expect(page.locator(".stage-message")).to_have_text("")


def walk(page: Page) -> None:
    """Turn until some more frames were shown, and rest."""
    wait_for_frames(page)
    shown = frames(page)
    page.keyboard.down("ArrowRight")
    wait_for_frames(page, shown + 6)
    page.keyboard.up("ArrowRight")
    wait_until_settled(page)
    expect(page.locator("[data-stat=requests]")).to_have_text("0")  # the figures are of now
