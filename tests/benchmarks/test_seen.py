"""What late pictures are grouped to for the simulator."""

from __future__ import annotations

import random

from benchmarks.reprojection import Sample
from benchmarks.seen import grouped


def late(turn: float, mse: float, ssim: float) -> Sample:
    return Sample("room", "walk", 0, 50, "depth", turn, 0.0, mse=mse, psnr_db=30, ssim=ssim, border=0)


def test_pictures_that_turned_about_as_far_are_one_group() -> None:
    samples = [late(turn, mse=10 * turn, ssim=1 - turn / 100) for turn in (1, 2, 3, 10, 20, 30)]
    random.Random(1).shuffle(samples)
    near, far = grouped(samples, 2)
    assert near == {"turn_deg": 2.0, "mse": 20.0, "ssim": 0.98}
    assert far == {"turn_deg": 20.0, "mse": 200.0, "ssim": 0.8}


def test_an_error_never_falls_where_the_view_has_turned_further() -> None:
    groups = grouped([late(1, 50, 0.9), late(2, 30, 0.95), late(3, 80, 0.8)], 3)
    assert [one["mse"] for one in groups] == [50, 50, 80]
    assert [one["ssim"] for one in groups] == [0.9, 0.9, 0.8]


def test_few_pictures_make_few_groups() -> None:
    assert len(grouped([late(1, 50, 0.9)], 8)) == 1
    assert grouped([]) == []
