"""The newest frame is turned to where the camera is, in a browser, behind a server that is slow to answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page, ViewportSize, expect

from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, frames_pass, hold, kept, picture, wait_for_frames, wait_until_settled

SMALL: ViewportSize = {"width": 320, "height": 180}
DELAY_MS = 300
SETTINGS = {
    "controller": "fixed",
    "profile": 3,
    "refine": False,
    "webp": False,
    "sidebar": False,
    "transport": "fetch",
    "prediction": "off",
}
TURN_MS = 1500

Recording = dict[str, Any]


@pytest.fixture
def slow(open_page: OpenPage, server: RenderServer) -> Callable[..., Page]:
    """Opens the viewer with a settled frame on the screen; every frame takes 300 ms longer than it would."""

    def open_(**settings: object) -> Page:
        chosen = with_settings(server.url, **(SETTINGS | settings))
        page = open_page(url="about:blank", viewport=SMALL, turn=True, **chosen)
        page.add_init_script(LATE)
        page.goto(server.url + SCENE)
        wait_for_frames(page)
        wait_until_settled(page)
        return page

    return open_


LATE = f"""
(() => {{
  const ask = window.fetch;
  window.sides = 0;
  window.fetch = async (...asked) => {{
    const frame = String(asked[0]).endsWith("render");
    while (frame && window.outage) await new Promise((on) => setTimeout(on, 50));
    const answer = await ask(...asked);
    if (frame) await new Promise((on) => setTimeout(on, {DELAY_MS}));
    const {{ width, height }} = frame ? JSON.parse(asked[1].body) : {{}};
    if (frame && width === height) window.sides++;
    return answer;
  }};
}})();
"""
SHAPED = """
size => {
  const canvas = document.querySelector("canvas.reprojected");
  const shape = canvas.width / canvas.height;
  const shown = canvas.clientWidth / canvas.clientHeight;
  return document.querySelector(".stage").clientWidth === size.width && Math.abs(shape / shown - 1) < 0.02;
}
"""
"""Whether the stage has this size, and the picture on it the shape that it is shown in."""
LOSE = """
() => {
  const gl = document.querySelector("canvas.reprojected").getContext("webgl2");
  window.loss = gl.getExtension("WEBGL_lose_context");
  window.loss.loseContext();
}
"""


def play(page: Page, *turns: tuple[float, float], capture_every_ms: float = 0) -> Recording:
    """Record a movement with these rotations to the right, in degrees, at these times, in milliseconds."""
    points = [{"t_ms": at, **pose(degrees)} for at, degrees in turns]
    plan = {"points": points, "duration_ms": turns[-1][0], "capture_every_ms": capture_every_ms}
    recording: Recording = page.evaluate("plan => tigas.run(plan)", plan)
    return recording


def pose(degrees: float) -> dict[str, Any]:
    """Where the scene's camera starts, turned to the right."""
    half = math.radians(degrees) / 2
    return {"position": [0, 0, 0], "quaternion": [0, math.sin(half), 0, math.cos(half)]}


def degrees_of(quaternion: list[float]) -> float:
    """Of such a pose."""
    return math.degrees(2 * math.atan2(quaternion[1], quaternion[3]))


def capture(page: Page, index: int) -> NDArray[np.int16]:
    """A kept picture: [height, width, 4]."""
    return np.asarray(kept(page, index).convert("RGBA"), dtype=np.int16)


def test_the_picture_turns_at_once_however_late_frames_are(slow: Callable[..., Page]) -> None:
    page = slow()
    run = play(page, (0, 0), (TURN_MS, 30))
    moving = [one for one in run["frames"] if one["latencies"]]
    assert len(moving) > 1
    for one in moving:
        # Counted in animation frames of any length: no sample waited for another one.
        assert len(one["latencies"]) == 1, "the picture does not turn with the camera"
        assert one["view"] >= one["pose"]
    sampled = {one["pose"]: one["at"] for one in run["inputs"] if not one["missed"]}
    ages = [one["at"] - sampled[one["pose"]] for one in moving if one["pose"] in sampled]
    assert min(ages, default=DELAY_MS + 1) > DELAY_MS
    assert max(one["filled"] for one in moving) > 0, "nothing says that the frame did not cover the view"


def test_what_is_seen_is_the_view_of_that_moment(slow: Callable[..., Page]) -> None:
    """Not only the page's word for it: the turned picture is far nearer to that view's own frame than a stale one."""
    errors = []
    for reprojection in (True, False):
        page = slow(reprojection=reprojection, overscan=0.25)
        run = play(page, (0, 0), (TURN_MS, 15), capture_every_ms=TURN_MS / 5)
        captured = run["captures"][3]
        known = [one for one in run["inputs"] if not one["missed"] and one["at"] < captured["at"]]
        now = next((one for one in known if one["pose"] == captured["view"]), known[-1])
        seen = capture(page, 3)
        truth = enlarged(view_at(page, degrees_of(now["quaternion"])), seen)
        height, width, _ = seen.shape
        middle = (slice(height // 4, -height // 4), slice(width // 4, -width // 4), slice(3))
        errors.append(float(np.abs(seen - truth)[middle].mean()))
    assert errors[0] < 0.6 * errors[1], errors


def test_in_an_outage_a_turn_shows_the_surround(slow: Callable[..., Page]) -> None:
    truth = view_at(slow(reprojection=False), 80)
    page = slow(overscan=0)
    page.wait_for_function("() => window.sides === 6")
    shown = turned_in_an_outage(page)
    assert (shown[..., 3] == 255).all()
    error = np.abs(shown - enlarged(truth, shown))[..., :3].mean()
    assert error < 0.5 * np.abs(truth - truth.mean(axis=(0, 1)))[..., :3].mean()


@pytest.mark.extended
def test_without_a_surround_an_outage_leaves_a_turn_without_a_picture(slow: Callable[..., Page]) -> None:
    shown = turned_in_an_outage(slow(overscan=0, surround=False))
    assert (shown[..., 3] == 0).mean() > 0.7


def test_at_rest_the_picture_is_the_frame_itself(slow: Callable[..., Page]) -> None:
    turned, plain = slow(overscan=0), slow(reprojection=False)  # with margins, another frame is compressed
    expect(turned.locator("canvas.reprojected")).to_have_count(1)
    expect(plain.locator("canvas.reprojected")).to_have_count(0)
    assert np.array_equal(view_at(turned, 20), view_at(plain, 20))


def test_a_lost_graphics_processor_leaves_the_view_as_large_as_it_was(slow: Callable[..., Page]) -> None:
    """The frame below has margins, which must be hidden."""
    page = slow(hud=False, overscan=0.25)
    before = picture(page)
    page.route("**/render", lambda route: None)  # no other frame takes its place
    page.evaluate(LOSE)
    expect(page.locator("canvas.reprojected")).to_have_count(0)
    after = picture(page)
    aside = np.abs(before - np.roll(before, 8, axis=1)).mean()
    assert np.abs(after - before).mean() < aside / 2


def test_a_resized_window_and_a_turned_phone_show_the_whole_view(slow: Callable[..., Page]) -> None:
    page = slow()
    sizes: list[ViewportSize] = [{"width": 180, "height": 320}, {"width": 400, "height": 200}]
    for size in sizes:
        page.set_viewport_size(size)
        page.wait_for_function(SHAPED, arg=size)
        wait_until_settled(page)
        assert page.evaluate(SHAPED, size)
        assert picture(page).std() > 10


def test_without_graphics_acceleration_nothing_is_turned(open_page: OpenPage, server: RenderServer) -> None:
    """Browsers under test draw in software, which would freeze a page of usual size."""
    page = open_page(SCENE, **with_settings(server.url, **(SETTINGS | {"sidebar": True})))
    wait_for_frames(page)
    expect(page.locator("[data-stat=reprojection-note]")).to_have_text(
        "This browser draws without the graphics processor: smooth turning is off."
    )
    hold(page, "ArrowRight")
    expect(page.locator("canvas.reprojected")).to_have_count(0)


def turned_in_an_outage(page: Page) -> NDArray[np.int16]:
    """The view 80° to the right once all frames have arrived; turned slowly, since a busy machine would make a
    cut of it.
    """
    page.evaluate("() => (window.outage = true)")
    run = play(page, (0, 0), (3 * TURN_MS, 80), (4 * TURN_MS, 80), capture_every_ms=TURN_MS / 4)
    return capture(page, len(run["captures"]) - 1)


def view_at(page: Page, degrees: float) -> NDArray[np.int16]:
    """The page's picture at rest, after a turn to the right."""
    page.evaluate("pose => tigas.stand(pose)", pose(degrees))
    frames_pass(page, 2)
    page.wait_for_function("() => tigas.state().ready")
    wait_until_settled(page)
    play(page, (0, degrees), (500, degrees), capture_every_ms=500)
    return capture(page, 0)


def enlarged(image: NDArray[np.int16], like: NDArray[np.int16]) -> NDArray[np.int16]:
    """As large as another."""
    size = (like.shape[1], like.shape[0])
    return np.asarray(Image.fromarray(image.astype(np.uint8)).resize(size), dtype=np.int16)
