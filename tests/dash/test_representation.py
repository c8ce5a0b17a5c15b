"""Which qualities a session offers."""

from __future__ import annotations

import json

import pytest

from tests.dash.conftest import session_request
from tigas_common.errors import InvalidRequest
from tigas_common.parsing import parse
from tigas_common.wire.dash import SessionRequest
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_dash.representation import representations


def offered(**changes: object) -> list[tuple[str, int, int]]:
    """Name and size of each representation, for a viewer of the usual ladder."""
    request = parse(SessionRequest, json.dumps(session_request(**changes)).encode())
    return [(one.id, one.width, one.height) for one in representations(request, DEFAULT_LADDER)]


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


def test_a_rung_may_have_several_bitrates() -> None:
    wanted = [{"rung": 3}, {"rung": 2, "bitrate_kbps": 900}, {"rung": 2}]
    assert [name for name, *_ in offered(representations=wanted)] == ["r2-1414", "r2-900", "r3-500"]


def test_the_same_representation_twice_is_refused() -> None:
    with pytest.raises(InvalidRequest, match="different bitrates"):
        offered(representations=[{"rung": 3}, {"rung": 3, "bitrate_kbps": 500}])
