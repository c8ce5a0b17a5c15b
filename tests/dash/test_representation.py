"""Which qualities a session offers."""

from __future__ import annotations

import pytest

from tests.dash.conftest import parsed_request
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_dash.representation import representations


def offered(**changes: object) -> list[tuple[str, int, int]]:
    """Name and size of each representation, for a viewer of the usual ladder."""
    return [(one.id, one.width, one.height) for one in representations(parsed_request(**changes), DEFAULT_LADDER)]


@pytest.mark.parametrize(
    ("viewport", "expected"),
    [
        ((640, 360), [("r2-4242", 640, 360), ("r2-1414", 640, 360), ("r3-500", 320, 180)]),
        ((1000, 600), [("r1-7800", 930, 558), ("r1-2600", 930, 558), ("r2-1415", 620, 372), ("r3-500", 310, 186)]),
        ((100, 100), [("r3-1500", 240, 240), ("r3-500", 240, 240)]),
    ],
)
def test_a_session_offers_no_more_pixels_than_are_shown_and_the_best_of_them_finer(
    viewport: tuple[int, int], expected: list[tuple[str, int, int]]
) -> None:
    width, height = viewport
    assert offered(width=width, height=height, representations=None) == expected


@pytest.mark.parametrize(
    ("viewport", "expected"),
    [
        ((1280, 720), ["r0-12000", "r0-4000", "r3-2096", "r5-1108", "r8-577"]),
        ((480, 270), ["r6-2757", "r6-919", "r8-577"]),
    ],
)
def test_of_a_ladder_with_many_rungs_a_few_sizes_are_offered(viewport: tuple[int, int], expected: list[str]) -> None:
    widths = (1280, 1120, 960, 832, 640, 544, 480, 480, 352, 352)
    ladder = [
        Rung(name=f"{i}", width=width, height=width * 9 // 16, quality=50, expected_kb=99 - i)
        for i, width in enumerate(widths)
    ]
    request = parsed_request(width=viewport[0], height=viewport[1], representations=None)
    assert [one.id for one in representations(request, ladder)] == expected
