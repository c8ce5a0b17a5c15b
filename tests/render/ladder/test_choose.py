"""The hull of the measurements, and the rungs on it."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from tigas_render.ladder.make import choose, hull, psnr_at, rung
from tigas_render.ladder.measure import Point


def point(kb: float, mse: float, width: int = 640, quality: int = 50) -> Point:
    return Point(width, width * 9 // 16, quality, kb, mse)


POINTS = [
    point(width / 100 * quality**0.5, 1e5 / (width / 100 * quality**0.5) ** 1.2 + 2 * abs(quality - 60), width, quality)
    for width in (256, 416, 640, 832, 960, 1120, 1280)
    for quality in range(10, 95, 5)
]
"""Error falls with bytes, least at one quality."""


def test_the_hull_has_no_setting_that_a_mixture_of_others_beats() -> None:
    good = [point(1, 100), point(2, 50), point(4, 20)]
    beaten = [point(3, 45), point(2, 60), point(5, 20), point(6, 30)]
    assert hull([*beaten, *good]) == good


def test_the_hull_gives_what_a_mixture_of_its_neighbours_does() -> None:
    best = hull([point(1, 100), point(2, 50)])
    assert psnr_at(best, 1.5) == pytest.approx(10 * math.log10(255**2 / 75))
    assert psnr_at(best, 2) == pytest.approx(best[-1].psnr_db)


@pytest.mark.parametrize("number", [8, 10, 16])
def test_rungs_go_from_the_best_to_the_smallest_without_a_jump(number: int) -> None:
    ladder = choose(POINTS, number)
    best = hull(POINTS)
    assert len(ladder) == number
    assert (ladder[0], ladder[-1]) == (rung(best[-1]), rung(best[0]))
    whole = math.log(best[-1].kb / best[0].kb)
    for better, worse in pairwise(ladder):
        assert worse.expected_kb < better.expected_kb
        assert (worse.psnr_db or 0) < (better.psnr_db or 0)
        assert worse.width <= better.width
        assert math.log(better.expected_kb / worse.expected_kb) < 2 * whole / (number - 1)
    assert len({one.name for one in ladder}) == number


def test_few_settings_give_few_rungs() -> None:
    assert [one.name for one in choose([point(1, 9, 256), point(2, 4, 640, 85)], 10)] == ["640×360 q85", "256×144 q50"]


def test_a_rung_never_has_more_pixels_than_a_better_one() -> None:
    points = [point(8, 1, 640), point(4, 2, 1280), point(2, 4, 640, 40), point(1, 9, 256)]
    assert [one.width for one in choose(points, 4)] == [640, 640, 256]
