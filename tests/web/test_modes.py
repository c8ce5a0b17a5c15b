"""The same walk in several modes: one JPEG per pose, a DASH stream, or two modes side by side."""

from __future__ import annotations

import time

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page, expect

from tests.web.conftest import PATIENCE, OpenPage
from tests.web.modes import wait_for_sessions, wait_for_stream, with_settings
from tests.web.server import Packager
from tests.web.stage import SCENE, expect_apart, hold, part, resize, wait_for_frames, wait_until_settled

WINDOW = {"width": 1000, "height": 700}
ALIKE = 10
"""Two pictures of one view, encoded differently, differ by less (0 to 255)."""
BOTH_SHOWN = """() => {
  const shown = document.querySelector(".stage")?.dataset.shown?.split(" ") ?? [];
  return shown.length === 2 && shown.every(Number);
}"""
"""Whether each side has shown a picture."""
ADD_FREEZE = """(stage) => stage.insertAdjacentHTML(
  "beforeend",
  '<p class="floating freeze row small">Stateless: frozen, no new picture for 12.3 s</p>',
)"""
"""A notice as of a picture that stands still, without the wait for one."""


def test_switching_the_mode_keeps_the_pose(open_page: OpenPage, viewer_url: str) -> None:
    chosen = with_settings(viewer_url, hud=False, reprojection=False, prediction="off")
    page = open_page(SCENE, url=viewer_url, viewport=WINDOW, **chosen)
    wait_for_frames(page)
    start = shown(page, "canvas")
    hold(page, "ArrowRight")
    wait_until_settled(page)
    turned = shown(page, "canvas")
    assert difference(start, turned) > 2 * ALIKE, "the camera stood still"

    switch(page, "dash")
    expect(page.locator(".stage canvas")).to_be_hidden()
    wait_until_shown(page, "video", turned)
    page.keyboard.down("ArrowLeft")
    wait_until_shown(page, "video", turned, alike=False)
    page.keyboard.up("ArrowLeft")
    page.wait_for_function("() => tigas.state().ready")
    last = shown(page, "video")

    switch(page, "side-by-side")
    left, right = page.locator(".pane:nth-child(1) canvas"), page.locator(".pane:nth-child(2) video")
    a, b = left.bounding_box(), right.bounding_box()
    assert a is not None
    assert b is not None
    assert a["width"] == pytest.approx(b["width"], abs=1)
    assert a["height"] == pytest.approx(b["height"], abs=1)
    assert a["x"] + a["width"] <= b["x"] + 1
    page.wait_for_function(BOTH_SHOWN)
    wait_until_settled(page)
    wait_for_stream(page, at_least=10)
    wait_until_shown(page, ".pane:nth-child(2) video", shown(page, ".pane:nth-child(1) canvas"))

    switch(page, "stateless")
    expect(page.locator(".stage video")).to_be_hidden()
    wait_until_shown(page, "canvas", last)


def test_the_stream_lasts_as_long_as_somebody_watches(open_page: OpenPage, viewer_url: str, packager: Packager) -> None:
    wait_for_sessions(packager, lambda sessions: not sessions)  # of the test before
    page = open_page(SCENE, url=viewer_url, **with_settings(viewer_url, mode="dash"))
    wait_for_stream(page)
    (stream,) = packager.sessions()
    page.evaluate("tigas.settings({ dashPreset: 'typical' })")
    wait_for_sessions(packager, lambda sessions: [one["id"] for one in sessions] != [stream["id"]])
    # A page that leaves before it knows its stream cannot end it.
    wait_for_sessions(packager, lambda sessions: len(sessions) == 1 and sessions[0]["watchers"] > 0)
    page.goto("about:blank")
    wait_for_sessions(packager, lambda sessions: not sessions)


def test_any_two_modes_are_compared_and_held_against_the_truth(open_page: OpenPage, viewer_url: str) -> None:
    chosen = with_settings(viewer_url, left="video", right="stateless", reprojection=False, hud=False, sidebar=True)
    page = open_page(f"{SCENE}?mode=side-by-side", url=viewer_url, viewport={"width": 860, "height": 180}, **chosen)
    # A walk begins anew when a side shows its first picture, and lasts for three seconds at least.
    page.wait_for_function(BOTH_SHOWN)
    page.keyboard.press("ArrowRight", delay=5000)
    for side in ("left", "right"):
        expect(page.locator(f".last-walk [data-side={side}][data-stat=psnr]")).to_contain_text("dB")
    expect(page.locator(".last-walk [role=status]")).to_contain_text("new views per second")
    for name in ("Motion to photon", "Bandwidth", "Time stalled", "Picture height"):
        expect(page.get_by_role("figure", name=name).locator("canvas")).to_be_visible()
    wait_until_settled(page)
    wait_until_shown(page, ".pane:nth-child(2) canvas", shown(page, ".pane:nth-child(1) canvas"))


@pytest.mark.parametrize("mode", ["stateless", "side-by-side"])
def test_the_notice_of_a_frozen_picture_is_clear_of_the_figures(open_page: OpenPage, mode: str) -> None:
    page = open_page(f"{SCENE}?mode={mode}&left=stateless&right=video")
    wait_for_frames(page)
    page.locator(".stage-area").evaluate(ADD_FREEZE)
    for details in (True, False):
        page.evaluate("hudDetails => tigas.settings({ hudDetails })", details)
        figures = ".status-line" if not details else ".side-hud" if mode == "side-by-side" else ".hud"
        expect(page.locator(figures)).to_have_count(2 if mode == "side-by-side" else 1)
        for width, height in (1000, 640), (1440, 900), (1920, 1080):
            resize(page, {"width": width, "height": height})
            expect_apart(page.locator(f"{figures}, .freeze, .title, [role=toolbar]"))


def switch(page: Page, mode: str) -> None:
    """To a mode, past those between."""
    while page.locator(".stage").get_attribute("data-mode") != mode:
        before = page.locator(".stage").get_attribute("data-mode")
        page.keyboard.press("m")
        expect(page.locator(".stage")).not_to_have_attribute("data-mode", str(before))


def shown(page: Page, element: str) -> NDArray[np.int16]:
    """An element of the stage, where no overlay is, as 32 × 18 pixels: [height, width, 3]."""
    middle = part(page, f".stage {element}", (0.35, 0.35, 0.3, 0.3))
    return np.asarray(middle.resize((32, 18), Image.Resampling.BOX), dtype=np.int16)


def difference(a: NDArray[np.int16], b: NDArray[np.int16]) -> float:
    """Mean absolute difference, 0 to 255."""
    return float(np.abs(a - b).mean())


def wait_until_shown(page: Page, element: str, picture: NDArray[np.int16], *, alike: bool = True) -> None:
    """Until an element shows the same view as a picture, or another one."""
    deadline = time.monotonic() + PATIENCE / 1000
    while (difference(shown(page, element), picture) < ALIKE) != alike:
        assert time.monotonic() < deadline, f"the {element} shows {'another' if alike else 'the same'} view"
        page.wait_for_timeout(100)
