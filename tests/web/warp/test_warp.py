"""The page's warp matches NumPy's prediction of the view from another camera."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page

from tests.web.warp.views import (
    HOME,
    WIDE,
    Stage,
    depth_of,
    encoded,
    far_away,
    flat_depth,
    noise,
    on_a_sphere,
    on_a_wall,
    psnr,
)


@pytest.mark.parametrize("margins", [(0, 0), (24, 14)])
def test_at_rest_the_pixels_are_the_frame_s(stage: Stage, margins: tuple[int, int]) -> None:
    x, y = margins
    frame = noise(96 + 2 * x, 54 + 2 * y)
    stage.take(frame, HOME.with_margins(x, y), flat_depth(0.5))
    shown = stage.draw(HOME)
    assert np.array_equal(shown[..., :3], frame[y : y + 54, x : x + 96])
    assert (shown[..., 3] == 255).all()


def test_what_is_enlarged_is_as_sharp_as_bicubic_makes_it(stage: Stage) -> None:
    frame = noise(96, 54)
    stage.take(frame, HOME)
    expected = np.asarray(Image.fromarray(frame).resize((288, 162), Image.Resampling.BICUBIC), dtype=int)
    difference = np.abs(stage.draw(HOME, enlarged=3)[..., :3] - expected)[6:-6, 6:-6]
    assert np.quantile(difference, 0.99) <= 2


def test_a_slow_graphics_processor_draws_a_simpler_picture(stage: Stage) -> None:
    frame = noise(96, 54)
    stage.take(frame, HOME)
    bicubic = stage.draw(HOME, enlarged=2)
    stage.page.evaluate("""async () => {
      const context = canvas.getContext("webgl2");
      const ask = context.getQueryParameter.bind(context);
      context.getQueryParameter = (query, name) => (name === context.QUERY_RESULT ? 20e6 : ask(query, name));
    }""")
    for _ in range(30):
        stage.draw(HOME, enlarged=2)
    assert stage.page.evaluate("warp.gpuMs") == 20
    simple = stage.draw(HOME, enlarged=2)
    expected = np.asarray(Image.fromarray(frame).resize((192, 108), Image.Resampling.BILINEAR))
    assert psnr(simple, expected) > psnr(bicubic, expected) + 6


def test_what_shrinks_does_not_flicker(stage: Stage) -> None:
    fine = np.kron(np.indices((108, 192)).sum(axis=0) % 2, np.ones((1, 1)))
    stage.take(np.repeat((255 * fine).astype(np.uint8)[..., None], 3, axis=2), HOME.scaled(2))
    shown = stage.draw(replace(HOME, turn=(0.2, 0.1, 0)))[4:-4, 4:-4, :3].astype(int)
    assert np.abs(shown - 127).max() < 20


@pytest.mark.parametrize("turn", [(4, 0, 0), (0, -3, 0), (0, 0, 8), (-5, 2, 3)])
def test_a_turned_frame_is_the_view(stage: Stage, turn: tuple[float, float, float]) -> None:
    stage.take(far_away(WIDE), WIDE)
    view = replace(HOME, turn=turn)
    shown = stage.draw(view)
    assert psnr(shown, far_away(view)) > 45
    assert psnr(far_away(HOME), far_away(view)) < 25, "the turn should make a difference"
    assert (shown[..., 3] == 255).all()


def test_a_step_before_a_wall_is_seen_by_its_depth(stage: Stage) -> None:
    stage.take(on_a_wall(WIDE, 4), WIDE, flat_depth(1 / 4))
    for position in [(0.3, 0, 0), (0, -0.2, 0.3), (-0.2, 0.1, -0.4)]:
        view = replace(HOME, position=position, turn=(2, -1, 3))
        assert psnr(stage.draw(view), on_a_wall(view, 4)) > 40
        assert psnr(on_a_wall(HOME, 4), on_a_wall(view, 4)) < 25, "the step should make a difference"


def test_a_wall_that_slants_away_is_bent_smoothly(stage: Stage) -> None:
    """To a camera that is turned, the wall's inverse depth falls from side to side."""
    frame = replace(WIDE, turn=(30, 0, 0))
    coarse = replace(frame, fx=20, fy=20, cx=18, cy=41 / 4, width=36, height=20)
    ahead = coarse.directions[..., 2]
    stage.take(on_a_wall(frame, 4), frame, depth_of(ahead / 4, float(ahead.max() / 4)))
    view = replace(HOME, turn=(30, 0, 0), position=(0.15, 0.05, 0.1))
    assert psnr(stage.draw(view), on_a_wall(view, 4)) > 36


def test_what_is_near_hides_what_is_far(stage: Stage) -> None:
    """A near red half on the left, a far blue one on the right: a step to the left moves red over blue."""
    frame = np.zeros((54, 96, 3), np.uint8)
    frame[:, :48, 0], frame[:, 48:, 2] = 255, 255
    inverse_depths = np.where(np.arange(24) < 12, 1.0, 0.0)[None].repeat(13, axis=0)
    stage.take(frame, HOME, depth_of(inverse_depths, 1.0))
    shown = stage.draw(replace(HOME, position=(-0.25, 0, 0)))
    assert (shown[:, 24:62, 0] > 200).all(), "20 pixels to the right"
    assert (shown[:, 72:, 2] > 200).all()
    uncovered = stage.draw(replace(HOME, position=(0.25, 0, 0)))
    assert (uncovered[:, :24, 0] > 200).all()
    assert (uncovered[:, 50:, 2] > 200).all()
    assert (uncovered[:, :75, 3] == 255).all(), "what comes out from behind is stretched, no hole"


def test_what_is_infinitely_far_stays_where_it_is(stage: Stage) -> None:
    codes = np.zeros((13, 23))
    codes[0, 0] = 0.5
    stage.take(far_away(WIDE), WIDE, depth_of(codes, 0.5))
    assert psnr(stage.draw(replace(HOME, position=(3, -2, 1))), far_away(HOME)) > 45


def test_without_depth_all_is_on_a_sphere(page: Page) -> None:
    stage = Stage(page, 5)
    home = replace(HOME, fx=32, fy=32)
    wide = home.with_margins(40, 24)
    stage.take(on_a_sphere(wide, 5), wide)
    view = replace(home, position=(0.6, 0.2, -0.7), turn=(-3, 2, 0))
    assert psnr(stage.draw(view), on_a_sphere(view, 5)) > 37
    assert psnr(on_a_sphere(home, 5), on_a_sphere(view, 5)) < 25, "the step should make a difference"


def test_at_an_infinite_distance_steps_change_nothing(stage: Stage) -> None:
    stage.take(noise(96, 54), HOME)
    assert np.array_equal(stage.draw(replace(HOME, position=(1, 2, 3))), stage.draw(HOME))


def test_frames_of_all_sizes_follow_each_other(stage: Stage) -> None:
    """Rungs, overscan and the canvas change; the view does not."""
    for scale, (x, y), enlarged in [(1, (0, 0), 2), (2, (10, 6), 1), (1, (24, 14), 1), (1, (3, 3), 2)]:
        frame = HOME.with_margins(x, y).scaled(scale)
        stage.take(far_away(frame), frame, flat_depth(0.5, 20 + x, 10 + y))
        shown = stage.draw(HOME, enlarged=enlarged)
        assert psnr(shown, far_away(HOME.scaled(enlarged))) > 38


def test_a_phone_that_is_turned_shows_the_frames_that_are_there(stage: Stage) -> None:
    stage.take(far_away(WIDE), WIDE)
    upright = replace(HOME, width=54, height=96, cx=27, cy=48)
    shown = stage.draw(upright)
    assert psnr(shown, far_away(upright), shown[..., 3] == 255) > 45
    assert (shown[10:-10, :, 3] == 255).all()


def test_a_lost_context_is_told_of_and_comes_back(page: Page) -> None:
    stage = Stage(page, None)
    stage.take(far_away(HOME), HOME)
    stage.draw(HOME)
    page.evaluate("() => (window.lose = canvas.getContext('webgl2').getExtension('WEBGL_lose_context')).loseContext()")
    page.wait_for_function("() => heard.includes('lost')")
    assert not page.evaluate("warp.working")
    stage.take(far_away(HOME), HOME)  # harmless
    assert not stage.draw(HOME).any()
    page.evaluate("warp.forget()")
    page.evaluate("lose.restoreContext()")
    page.wait_for_function("() => heard.includes('restored')")
    assert page.evaluate("warp.working")
    assert not stage.draw(HOME).any(), "the frame was lost, too"
    for degrees in (0, 30):
        seen = replace(WIDE, turn=(degrees, 0, 0))
        stage.take(far_away(seen), seen, flat_depth(0.1))
        stage.draw(seen)
    view = replace(HOME, turn=(2, 0, 0))
    assert psnr(stage.draw(view), far_away(view)) > 33


def test_a_warp_that_is_disposed_of_leaves_its_context_to_others(page: Page) -> None:
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    for _ in range(20):
        stage = Stage(page, None)
        stage.take(far_away(HOME), HOME)
        stage.draw(HOME)
    assert page.evaluate("heard") == []
    assert [complaint for complaint in complaints if "ReadPixels" not in complaint] == []


def test_a_video_is_turned_like_any_picture(page: Page) -> None:
    stage = Stage(page, None)
    playing = """async (png) => {
      const bitmap = await createImageBitmap(new Blob([bytes(png)]));
      const source = Object.assign(document.createElement("canvas"), { width: bitmap.width, height: bitmap.height });
      window.video = Object.assign(document.createElement("video"), { muted: true });
      warp.take(video, view, null); // it has no picture yet
      const context = source.getContext("2d");
      context.drawImage(bitmap, 0, 0);
      video.srcObject = source.captureStream();
      const shown = new Promise((resolve) => video.requestVideoFrameCallback(resolve));
      await video.play();
      context.drawImage(bitmap, 0, 0);
      await shown;
      warp.take(video, view, null);
    }"""
    stage.page.evaluate(f"(view) => {{ window.view = view; window.play = {playing}; }}", WIDE.message)
    stage.page.evaluate("(png) => play(png)", base64.b64encode(encoded(far_away(WIDE), "png")).decode())
    view = replace(HOME, turn=(4, 1, 2))
    assert psnr(stage.draw(view), far_away(view)) > 30


def test_without_webgl_there_is_no_warp(page: Page) -> None:
    """As where a canvas already has another context."""
    working = page.evaluate("""async () => {
      const { Warp } = await import("/warp.js");
      const canvas = document.createElement("canvas");
      canvas.getContext("2d");
      const warp = new Warp(canvas, { distance: 1 });
      const view = { position: [0, 0, 0], quaternion: [0, 0, 0, 1], fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 };
      warp.take(new ImageData(2, 2), view, null);
      warp.draw(view);
      warp.forget();
      warp.dispose();
      return warp.working;
    }""")
    assert working is False
