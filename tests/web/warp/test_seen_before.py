"""Where the newest frame has no pixels, the page shows earlier views, or the surround."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from playwright.sync_api import Page

from tests.web.warp.views import (
    HOME,
    WIDE,
    Stage,
    View,
    far_away,
    on_a_sphere,
    psnr,
)


def test_where_nothing_was_seen_the_canvas_is_transparent(stage: Stage) -> None:
    stage.take(far_away(HOME), HOME)
    view = replace(HOME, turn=(20, 5, 10))
    shown = stage.draw(view)
    _, known = HOME.pixels_of(view.directions)
    opaque = shown[..., 3] == 255
    assert 0.3 < known.mean() < 0.8
    assert (opaque == known).mean() > 0.98
    assert set(np.unique(shown[..., 3])) == {0, 255}
    assert not shown[shown[..., 3] == 0].any(), "premultiplied"
    assert psnr(shown, far_away(view), opaque & known) > 40, "up to the frame's edge, which does not smear"


def test_what_was_seen_before_fills_the_view(stage: Stage) -> None:
    for degrees in (0, 30):
        seen = replace(WIDE, turn=(degrees, 0, 0))
        stage.take(far_away(seen), seen)
        stage.draw(seen)
    view = replace(HOME, turn=(2, 0, 0))
    shown = stage.draw(view)
    _, newest = seen.pixels_of(view.directions)
    assert 0.2 < newest.mean() < 0.8
    assert (shown[..., 3] == 255).all()
    assert psnr(shown, far_away(view), ~newest) > 33
    assert psnr(shown, far_away(view), newest) > 40


@pytest.mark.parametrize(
    "turn", [(90, 0, 0), (180, 0, 0), (-90, 0, 0), (45, 0, 0), (0, 85, 0), (0, -85, 0), (150, 40, 70)]
)
def test_every_side_is_remembered(stage: Stage, turn: tuple[float, float, float]) -> None:
    seen, aside = replace(WIDE, turn=turn), replace(WIDE, turn=(turn[0] + 120, 0, 0))
    for view in (seen, aside):
        stage.take(far_away(view), view)
        stage.draw(view)
    view = replace(HOME, turn=turn)
    _, newest = aside.pixels_of(view.directions)
    assert psnr(stage.draw(view), far_away(view), ~newest) > 33


def test_after_a_cut_nothing_from_before_is_seen(stage: Stage) -> None:
    stage.take(far_away(HOME), HOME)
    stage.draw(HOME)
    stage.page.evaluate("warp.forget()")
    assert not stage.draw(HOME).any()
    aside = replace(HOME, turn=(25, 0, 0))
    stage.take(far_away(aside), aside)
    _, known = aside.pixels_of(HOME.directions)
    assert ((stage.draw(HOME)[..., 3] == 255) == known).mean() > 0.98


@pytest.mark.parametrize(("walked", "filled"), [(0.8, True), (1.2, False)])
def test_what_was_seen_is_dropped_after_a_quarter_of_the_distance(page: Page, walked: float, filled: bool) -> None:
    stage = Stage(page, 4)
    back = replace(HOME, turn=(180, 0, 0))
    stage.take(far_away(back), back)
    stage.draw(back)
    ahead = replace(HOME, position=(0, 0, walked))
    stage.take(far_away(ahead), ahead)
    assert (stage.draw(replace(ahead, turn=(180, 0, 0)))[..., 3] == 255).all() == filled


SIDE = View(fx=64 / math.tan(math.radians(49)), fy=64 / math.tan(math.radians(49)), cx=64, cy=64, width=128, height=128)


def test_the_surround_is_seen_where_nothing_else_is(stage: Stage) -> None:
    """The picture is complete for any direction of the view; frames rendered for it have priority."""
    stage.take(far_away(HOME), HOME)
    for turn in ((0, 0, 0), (90, 0, 0), (180, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0)):
        side = replace(SIDE, turn=turn)
        stage.surround(far_away(side), side)
    for turn in ((20, 5, 10), (130, -20, 0), (-45, 30, 0), (200, 80, 30)):
        view = replace(HOME, turn=turn)
        shown = stage.draw(view)
        _, newest = HOME.pixels_of(view.directions)
        assert (shown[..., 3] == 255).all()
        assert psnr(shown, far_away(view), ~newest) > 30
        assert not newest.any() or psnr(shown, far_away(view), newest) > 40


@pytest.mark.parametrize("behind", ["an earlier frame", "the surround"])
def test_newer_frames_replace_what_was_seen_which_goes_before_the_surround(stage: Stage, behind: str) -> None:
    frames = [(200, HOME), (90, replace(HOME, turn=(100, 0, 0)))]
    if behind == "the surround":
        stage.surround(np.full((128, 128, 3), 50, np.uint8), SIDE)
    else:
        frames.insert(0, (50, WIDE))
    for value, view in frames:
        stage.take(np.full((view.height, view.width, 3), value, np.uint8), view)
        stage.draw(view)
    shown = stage.draw(WIDE)[..., 0]
    assert (shown[18:-18, 28:-28] == 200).all()
    assert (shown[:12] == 50).all()


def test_a_side_is_seen_from_where_the_camera_is_by_now(page: Page) -> None:
    """All that it shows is on a sphere around the place where it was taken, as long as the camera is within."""
    stage = Stage(page, 5)
    back = replace(HOME, turn=(180, 0, 0))
    stage.take(far_away(back), back)
    stage.surround(on_a_sphere(SIDE, 5), SIDE)
    view = replace(HOME, position=(-0.8, 0.3, -1.5), turn=(5, 3, 0))
    assert psnr(stage.draw(view), on_a_sphere(view, 5)) > 30
    assert psnr(on_a_sphere(HOME, 5), on_a_sphere(view, 5)) < 25, "the step should make a difference"
    outside = replace(HOME, position=(0, 0, -4.6))
    assert not stage.draw(outside).any()


def test_of_two_sides_that_show_the_same_the_one_from_nearer_is_seen(page: Page) -> None:
    stage = Stage(page, 5)
    back = replace(HOME, turn=(180, 0, 0))
    stage.take(far_away(back), back)
    sides = {90: SIDE, 200: replace(SIDE, position=(2, 0, 0), turn=(4, 0, 0))}
    for value, side in sides.items():
        stage.surround(np.full((128, 128, 3), value, np.uint8), side)
    assert (stage.draw(HOME)[..., 0] == 90).all()
    assert (stage.draw(replace(HOME, position=(1.9, 0, 0)))[..., 0] == 200).all()


def test_a_side_takes_the_place_of_the_one_before_and_a_cut_forgets_it(stage: Stage) -> None:
    back = replace(HOME, turn=(180, 0, 0))
    stage.take(far_away(back), back)
    for value in (50, 70):
        stage.surround(np.full((128, 128, 3), value, np.uint8), SIDE)
    assert (stage.draw(HOME)[..., 0] == 70).all()
    stage.page.evaluate("warp.forget()")
    stage.take(far_away(back), back)
    assert not stage.draw(HOME).any()
