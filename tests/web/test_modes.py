"""The same walk in three modes: one JPEG per pose, a DASH stream, or both beside each other."""

from __future__ import annotations

import io
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page, expect

from tests.web.conftest import PATIENCE, OpenPage
from tests.web.modes import dash_frames, wait_for_dash, with_settings
from tests.web.server import Packager
from tests.web.stage import SCENE, stat, wait_for_frames, wait_until_settled

pytest.importorskip("tigas_dash")
pytest.importorskip("av")
WINDOW = {"width": 1000, "height": 700}


def test_switching_the_mode_keeps_the_pose(open_page: OpenPage, viewer_url: str) -> None:
    page = open_page(SCENE, url=viewer_url, viewport=WINDOW)
    wait_for_frames(page)
    page.keyboard.press("ArrowRight", delay=400)
    wait_until_settled(page)
    jpeg = shown(page, "canvas")

    page.keyboard.press("m")
    expect(page.locator(".stage")).to_have_attribute("data-mode", "dash")
    wait_for_dash(page, at_least=30)
    expect(page.locator(".stage canvas")).to_be_hidden()
    video = shown(page, "video")
    assert np.abs(video - jpeg).mean() < 20, "the stream shows another view"

    before = dash_frames(page)
    page.keyboard.press("ArrowRight", delay=400)
    wait_for_dash(page, before + 60)
    turned = shown(page, "video")
    assert np.abs(turned - video).mean() > 20, "the stream's camera stood still"

    page.keyboard.press("m")
    expect(page.locator(".stage")).to_have_attribute("data-mode", "side-by-side")
    wait_for_dash(page, at_least=30)
    left, right = page.locator(".stage canvas"), page.locator(".stage video")
    expect(left).to_be_visible()
    expect(right).to_be_visible()
    a, b = left.bounding_box(), right.bounding_box()
    assert a is not None
    assert b is not None
    assert a["width"] == pytest.approx(b["width"], abs=1)
    assert a["height"] == pytest.approx(b["height"], abs=1)
    assert a["x"] + a["width"] <= b["x"] + 1
    wait_until_settled(page)
    assert np.abs(shown(page, "canvas") - shown(page, "video")).mean() < 20, "the two sides show different views"

    page.keyboard.press("m")
    expect(page.locator(".stage")).to_have_attribute("data-mode", "stateless")
    expect(page.locator(".stage video")).to_be_hidden()
    expect(page.locator(".stage")).to_have_attribute("data-dash", "off")
    wait_until_settled(page)
    assert np.abs(shown(page, "canvas") - turned).mean() < 20, "the pose was lost"


def test_the_stream_lasts_as_long_as_somebody_watches(open_page: OpenPage, viewer_url: str, packager: Packager) -> None:
    page = open_page(SCENE, url=viewer_url, **with_settings(viewer_url, mode="dash"))
    wait_for_dash(page)
    (stream,) = packager.sessions()
    page.evaluate("tigas.settings({ dashPreset: 'typical' })")
    wait_for_sessions(packager, lambda sessions: [one["id"] for one in sessions] != [stream["id"]])
    wait_for_sessions(packager, lambda sessions: len(sessions) == 1)
    page.goto("about:blank")
    wait_for_sessions(packager, lambda sessions: not sessions)


def test_a_lost_packager_is_announced_and_found_again(open_page: OpenPage, viewer_url: str, packager: Packager) -> None:
    chosen = with_settings(viewer_url, mode="side-by-side")
    page = open_page(SCENE, url=viewer_url, expected_errors="ERR_", **chosen)
    wait_for_frames(page)
    wait_for_dash(page)
    packager.kill()
    expect(page.locator(".stage-message")).to_contain_text("Trying again")
    before = int(page.locator(".stage").get_attribute("data-frames") or 0)
    page.keyboard.press("ArrowRight", delay=300)
    wait_for_frames(page, before + 2)  # the other side goes on
    packager.start()
    expect(page.locator(".stage-message")).to_have_text("")
    wait_for_dash(page, at_least=10)


def test_without_a_packager_one_sentence_says_so(open_page: OpenPage) -> None:
    page = open_page(SCENE)
    wait_for_frames(page)
    page.keyboard.press("m")
    expect(page.locator(".stage-message")).to_contain_text("no DASH packager")
    page.keyboard.press("m")
    wait_for_frames(page)
    page.keyboard.press("m")
    expect(page.locator(".stage-message")).to_have_text("")


def test_both_sides_are_measured(open_page: OpenPage, viewer_url: str) -> None:
    page = open_page(SCENE, url=viewer_url, **with_settings(viewer_url, mode="side-by-side"))
    wait_for_frames(page)
    wait_for_dash(page)
    page.keyboard.down("ArrowRight")
    for side in ("stateless", "dash"):
        for name in ("motion-to-photon", "bandwidth"):
            page.wait_for_function(
                "where => parseFloat(document.querySelector(where)?.innerText) > 0",
                arg=f"[data-side={side}] [data-stat={name}]",
            )
    page.keyboard.up("ArrowRight")
    assert "×" in page.locator("[data-side=dash] [data-stat=resolution]").inner_text()
    for name in ("Motion to photon", "Bandwidth", "Time stalled", "Picture height"):
        expect(page.get_by_role("figure", name=name).locator("canvas")).to_be_visible()


def test_the_stateless_page_does_not_load_the_player(open_page: OpenPage, viewer_url: str) -> None:
    page = open_page(SCENE, url=viewer_url)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.reload()
    wait_for_frames(page)
    assert not [url for url in asked if "stream" in url or "dash" in url]
    assert stat(page, "transport") == "WebTransport streams"


def shown(page: Page, element: str) -> NDArray[np.int16]:
    """What an element of the stage shows, where nothing floats over it, as 64 × 36 pixels: [height, width, 3]."""
    box = page.locator(f".stage {element}").bounding_box()
    assert box is not None
    clip = {
        "x": box["x"] + box["width"] * 0.35,
        "y": box["y"] + box["height"] * 0.35,
        "width": box["width"] * 0.3,
        "height": box["height"] * 0.3,
    }
    with Image.open(io.BytesIO(page.screenshot(clip=clip))) as image:  # type: ignore[arg-type]
        return np.asarray(image.convert("RGB").resize((64, 36)), dtype=np.int16)


def wait_for_sessions(packager: Packager, wanted: Callable[[list[dict[str, Any]]], bool]) -> None:
    """Until the packager's streams are as wanted."""
    deadline = time.monotonic() + PATIENCE / 1000
    while not wanted(packager.sessions()):
        assert time.monotonic() < deadline, f"the packager has {packager.sessions()}"
        time.sleep(0.1)
