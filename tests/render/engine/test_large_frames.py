"""Frames larger than a display needs wait until no other client is active; others are always admitted."""

from __future__ import annotations

import pytest

from tests.render.fakes import render_request
from tigas_common.errors import Overloaded
from tigas_common.wire.render import DEFAULT_LADDER, RenderRequest
from tigas_render.engine.cost_model import ACTIVE_S, USUAL_OVERSCAN, CostModel, LargeFrames
from tigas_render.engine.frame_size import FrameSize
from tigas_render.frame import Client

LARGE, HUGE = 1280 * 720, 4096 * 4096
HOSTILE, POLITE = Client("h", "1"), Client("p", "1")


def huge(**changes: object) -> RenderRequest:
    return render_request(**({"width": 4096, "height": 4096, "profile": None} | changes))


@pytest.fixture
def costs() -> CostModel:
    """A CPU's."""
    costs = CostModel()
    costs.measured("scene", "jpeg", LARGE, 0.16)
    return costs


def check(admission: LargeFrames, request: RenderRequest, now: float, *, others_wait: bool = False) -> None:
    admission.check(HOSTILE, request, FrameSize.of(request, DEFAULT_LADDER), now, others_wait=others_wait)


def refused(admission: LargeFrames, request: RenderRequest, now: float) -> bool:
    try:
        check(admission, request, now)
    except Overloaded:
        return True
    return False


def test_huge_frames_are_refused_while_somebody_else_is_active(costs: CostModel) -> None:
    admission = LargeFrames(DEFAULT_LADDER, costs)
    admission.heard_of(HOSTILE, 100.0)
    assert not refused(admission, huge(), 100.0)
    admission.heard_of(POLITE, 101.0)
    with pytest.raises(Overloaded, match="4096×4096") as refusal:
        check(admission, huge(), 101.0)
    assert refusal.value.retry_after_s == ACTIVE_S
    assert refused(admission, huge(), 102.9)
    assert not refused(admission, huge(), 103.1)


def test_another_session_of_the_same_address_is_somebody_else(costs: CostModel) -> None:
    admission = LargeFrames(DEFAULT_LADDER, costs)
    admission.heard_of(Client(HOSTILE.address, "2"), 100.0)
    assert refused(admission, huge(), 100.0)


def test_what_a_display_needs_is_never_refused(costs: CostModel) -> None:
    admission = LargeFrames(DEFAULT_LADDER, costs)
    admission.heard_of(POLITE, 100.0)
    assert not refused(admission, huge(profile=0), 100.0)
    assert not refused(admission, huge(width=1280, height=720), 100.0)
    assert not refused(admission, huge(width=1280, height=800), 100.0), "it costs no more"
    assert not refused(admission, huge(profile=0, overscan=USUAL_OVERSCAN), 100.0)


def test_margins_count(costs: CostModel) -> None:
    admission = LargeFrames(DEFAULT_LADDER, costs)
    admission.heard_of(POLITE, 100.0)
    assert refused(admission, huge(width=1280, height=720, overscan=0.2), 100.0)
    assert refused(admission, huge(profile=0, overscan=0.5), 100.0)
    assert not refused(admission, huge(profile=2, overscan=0.5), 100.0)


def test_where_huge_frames_are_quick_nobody_minds() -> None:
    costs = CostModel()
    costs.measured("scene", "jpeg", HUGE, 0.02)
    admission = LargeFrames(DEFAULT_LADDER, costs)
    admission.heard_of(POLITE, 100.0)
    assert not refused(admission, huge(), 100.0)


def test_huge_frames_of_unknown_cost_are_refused() -> None:
    admission = LargeFrames(DEFAULT_LADDER, CostModel())
    admission.heard_of(POLITE, 100.0)
    assert refused(admission, huge(), 100.0)


def test_whoever_waits_is_active_however_long(costs: CostModel) -> None:
    with pytest.raises(Overloaded):
        check(LargeFrames(DEFAULT_LADDER, costs), huge(), 100.0, others_wait=True)
