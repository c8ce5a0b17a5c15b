"""Which of the measured settings become rungs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tigas_common.wire.render import Rung
from tigas_render.ladder.measure import Point

RUNGS = 10


def hull(points: Sequence[Point]) -> list[Point]:
    """The lower convex hull of mean squared error over bytes, from the fewest bytes to the least error.

    No mixture of other settings has less error at the same bytes: the hull of per-title encoding (Netflix, 2015). PSNR
    over the logarithm of bytes is unsuitable, because nearly all of its points are below the line between its ends.
    """
    kept: list[Point] = []
    for point in sorted(points, key=lambda point: (point.kb, point.mse)):
        if kept and point.mse >= kept[-1].mse:
            continue
        while len(kept) > 1 and _slope(kept[-2], point) <= _slope(kept[-2], kept[-1]):
            kept.pop()
        kept.append(point)
    return kept


def choose(points: Sequence[Point], number: int = RUNGS) -> tuple[Rung, ...]:
    """This many rungs, or fewer if the hull has no more; best first.

    They are on the hull, spaced as evenly by the logarithm of bytes as possible, so that no switch is a jump, and none
    has more pixels than a better one, so that less detail never takes longer to render.
    """
    kept = hull(points)
    low, high = math.log(kept[0].kb), math.log(kept[-1].kb)
    chosen = [kept[-1]]
    for step in range(1, number):
        wanted = high + (low - high) * step / (number - 1)
        worse = [
            point
            for point in kept
            if point.kb < chosen[-1].kb and point.width * point.height <= chosen[-1].width * chosen[-1].height
        ]
        if not worse:
            break
        chosen.append(min(worse, key=lambda point: abs(math.log(point.kb) - wanted)))
    return tuple(rung(point) for point in chosen)


def psnr_at(kept: Sequence[Point], kb: float) -> float:
    """PSNR in dB of a hull at this many kilobytes: of frames mixed from its two nearest settings."""
    mse = np.interp(kb, [point.kb for point in kept], [point.mse for point in kept])
    return 10 * math.log10(255**2 / float(mse))


def rung(point: Point) -> Rung:
    """A setting as a rung, with its measured bytes and error."""
    return Rung(
        name=point.name,
        width=point.width,
        height=point.height,
        quality=point.quality,
        expected_kb=round(point.kb, 2),
        psnr_db=round(point.psnr_db, 2),
    )


def _slope(start: Point, end: Point) -> float:
    return (end.mse - start.mse) / (end.kb - start.kb)
