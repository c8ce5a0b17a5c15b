"""Late reprojection of a DASH stream: the view follows the camera at once, while the stream's own latency is
unchanged.
"""

from __future__ import annotations

import io
from bisect import bisect_left
from statistics import median
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.modes import wait_for_stream, with_settings
from tests.web.stage import SCENE
from tests.web.test_motion_to_photon import WALK_MS, turning

pytestmark = pytest.mark.alone

Pixels = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SMALL = {"width": 260, "height": 200}
"""Where there is no graphics processor, turning a picture takes time for each pixel."""
PLAIN = {"prediction": "off", "hud": False, "sidebar": False, "dashPreset": "edge", "controller": "fixed", "profile": 3}


def walk(page: Page) -> dict[str, Any]:
    """Half a turn, recorded."""
    run: dict[str, Any] = page.evaluate(
        "plan => tigas.run(plan)", {"points": turning(), "duration_ms": WALK_MS, "capture_every_ms": 1000}
    )
    return run


def frames_of(run: dict[str, Any], side: str) -> list[dict[str, Any]]:
    """The screen while the camera turned."""
    moved = {one["pose"] for one in run["inputs"]}
    return [one for one in run["frames"] if one["side"] == side and one["pose"] in moved and one["at"] < WALK_MS]


def assert_turned(run: dict[str, Any], side: str) -> None:
    """Views were there by the next animation frame, which is late on a busy machine; their pixels were older."""
    sampled = {one["pose"]: one["at"] for one in run["inputs"] if not one["missed"]}
    times = sorted(sampled.values())
    frames = [one for one in frames_of(run, side) if one["view"] in sampled]
    assert len(frames) >= 5, f"{side} showed hardly anything"
    waits = [bisect_left(times, one["at"]) - bisect_left(times, sampled[one["view"]]) for one in frames]
    assert median(waits) <= 1, f"in animation frames: {waits}"
    ages = [one["at"] - sampled[one["pose"]] for one in frames if one["pose"] in sampled]
    assert median(ages) > median(one["at"] - sampled[one["view"]] for one in frames)
    if side == "dash":
        assert median(ages) > run["dash"]["target_latency_ms"]


def test_the_view_follows_the_camera_and_at_rest_nothing_is_stretched(open_page: OpenPage, viewer_url: str) -> None:
    chosen = with_settings(viewer_url, mode="dash", reprojection=True, **PLAIN)
    page = open_page(SCENE, url=viewer_url, viewport=SMALL, turn=True, **chosen)
    wait_for_stream(page, at_least=30)
    run = walk(page)
    assert_turned(run, "dash")
    pictures = [(one["width"], one["height"]) for one in run["captures"]]
    assert len(pictures) >= 3
    assert set(pictures) == {(SMALL["width"], SMALL["height"])}, "a turned picture has the stage's pixels"
    turned = at_rest(page)
    page.evaluate("tigas.settings({ reprojection: false })")
    expect(page.locator("canvas.reprojected")).to_have_count(0)
    page.wait_for_function("() => tigas.state().ready")
    wait_for_stream(page, at_least=30)
    plain = at_rest(page)
    assert_same_view(turned, plain)
    assert all(one["view"] is None for one in frames_of(walk(page), "dash"))


def test_side_by_side_both_follow_it(open_page: OpenPage, viewer_url: str) -> None:
    # dash.js still schedules a download while it is being reset, and logs that its buffer is gone.
    page = open_page(
        SCENE,
        url=viewer_url,
        expected_errors="getAllRangesWithSafetyFactor",
        viewport=SMALL | {"width": 2 * SMALL["width"]},
        turn=True,
        **with_settings(viewer_url, mode="side-by-side", reprojection=True, **PLAIN),
    )
    wait_for_stream(page, at_least=30)
    expect(page.locator(".pane > canvas.reprojected")).to_have_count(2)
    run = walk(page)
    for side in ("stateless", "dash"):
        assert_turned(run, side)


def assert_same_view(turned: Pixels, plain: Pixels) -> None:
    """Much less apart than from itself a few pixels aside."""
    shifted = np.abs(plain - np.roll(plain, 8, axis=1)).mean()
    assert np.abs(turned - plain).mean() < shifted / 3


def at_rest(page: Page) -> Pixels:
    """The lower half of the stage, free of overlays, once the encoder has settled."""
    page.evaluate("tigas.stand({ position: [0, 0, 0], quaternion: [0, 0, 0, 1] })")
    page.wait_for_function("() => tigas.state().ready")
    shown = page.evaluate("tigas.state().shown")
    page.wait_for_function("shown => tigas.state().shown > shown + 40", arg=shown)
    picture = Image.open(io.BytesIO(page.locator(".stage").screenshot())).convert("RGB")
    return np.asarray(picture, dtype=np.float64)[picture.height // 2 :]
