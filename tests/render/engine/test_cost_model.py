"""Predicted costs of frames are bounded by those of others, and large frames wait until no other client is active."""

from __future__ import annotations

import math
from typing import Any

import pytest

from tests.render.fakes import render_request
from tigas_common.errors import Overloaded
from tigas_common.wire.render import DEFAULT_LADDER, AnswerFormat
from tigas_render.engine.cost_model import ACTIVE_S, NORMAL_OVERSCAN, CostModel, LargeFrameLimit
from tigas_render.engine.frame_size import FrameSize
from tigas_render.frame import Client

MEDIUM, LARGE, HUGE = 640 * 360, 1280 * 720, 4096 * 4096
HOSTILE, POLITE = Client("h", "1/5001"), Client("p", "1")

Measured = tuple[str, AnswerFormat, int, float]


def costs(*measured: Measured) -> CostModel:
    model = CostModel()
    for each in measured:
        model.add_measurement(*each)
    return model


A_LARGE: Measured = ("scene", "jpeg", LARGE, 0.16)
"""A CPU's."""


@pytest.mark.parametrize(
    ("measured", "pixels", "lower", "upper"),
    [
        ([("other", "jpeg", LARGE, 0.1), ("scene", "png", LARGE, 0.1)], LARGE, 0, math.inf),
        ([("scene", "jpeg", LARGE, 1.0), *[("scene", "jpeg", LARGE, 0.1)] * 30], LARGE, 0.1, 0.1),
        ([A_LARGE], HUGE, 0.16, 0.16 * 2**5),
        ([A_LARGE], MEDIUM, 0.16 / 4, 0.16),
        ([("scene", "jpeg", 1, 0.1)] * 100, LARGE, 0.1, 0.1 * 2**19),
    ],
    ids=["others tell nothing", "the newest count most", "larger", "smaller", "tiny ones tell little"],
)
def test_costs_are_bounded(measured: list[Measured], pixels: int, lower: float, upper: float) -> None:
    model = costs(*measured)
    assert model.lower_bound("scene", "jpeg", pixels) == pytest.approx(lower, 0.05)
    assert model.upper_bound("scene", "jpeg", pixels) == pytest.approx(upper, 0.05)


def test_what_is_doubted_fades() -> None:
    model = costs(("scene", "jpeg", LARGE, 1.0))
    for _ in range(30):
        model.decay("scene", "jpeg")
    assert model.lower_bound("scene", "jpeg", LARGE) < 0.05


OTHER_AT_100 = [(POLITE, 100.0)]


@pytest.mark.parametrize(
    ("changes", "active", "now", "is_refused"),
    [
        ({}, [(HOSTILE, 100.0)], 100.0, False),
        ({}, [(HOSTILE, 100.0), (POLITE, 101.0)], 102.9, True),
        ({}, [(HOSTILE, 100.0), (POLITE, 101.0)], 103.1, False),
        ({}, [(Client(HOSTILE.address, "2"), 100.0)], 100.0, True),
        ({}, [(Client(HOSTILE.address, "1/5002"), 100.0)], 100.0, False),
        ({}, [(Client(HOSTILE.address, "2/5002"), 100.0)], 100.0, True),
        ({"profile": 0}, OTHER_AT_100, 100.0, False),
        ({"profile": 0, "overscan": NORMAL_OVERSCAN}, OTHER_AT_100, 100.0, False),
        ({"profile": 0, "overscan": 0.5}, OTHER_AT_100, 100.0, True),
        ({"profile": 2, "overscan": 0.5}, OTHER_AT_100, 100.0, False),
        ({"width": 1280, "height": 720}, OTHER_AT_100, 100.0, False),
        ({"width": 1280, "height": 720, "overscan": 0.2}, OTHER_AT_100, 100.0, True),
        ({"width": 1280, "height": 800}, OTHER_AT_100, 100.0, False),  # it costs no more
    ],
)
def test_huge_frames_are_refused_while_another_client_is_active(
    changes: dict[str, Any], active: list[tuple[Client, float]], now: float, is_refused: bool
) -> None:
    large_frames = LargeFrameLimit(DEFAULT_LADDER, costs(A_LARGE))
    for client, at in active:
        large_frames.record_activity(client, at)
    assert refused(large_frames, now, **changes) == is_refused


@pytest.mark.parametrize(
    ("measured", "is_refused"), [([("scene", "jpeg", HUGE, 0.02)], False), ([], True)], ids=["quick", "unknown"]
)
def test_the_cost_of_huge_frames_counts(measured: list[Measured], is_refused: bool) -> None:
    large_frames = LargeFrameLimit(DEFAULT_LADDER, costs(*measured))
    large_frames.record_activity(POLITE, 100.0)
    assert refused(large_frames, 100.0) == is_refused


def test_whoever_waits_is_active_however_long() -> None:
    assert refused(LargeFrameLimit(DEFAULT_LADDER, costs(A_LARGE)), 100.0, others_wait=True)


def refused(large_frames: LargeFrameLimit, now: float, *, others_wait: bool = False, **changes: Any) -> bool:
    """Whether the hostile client's frame, huge unless changed, is refused until others count as inactive."""
    request = render_request(**{"width": 4096, "height": 4096, "profile": None} | changes)
    try:
        large_frames.check(
            HOSTILE, request, FrameSize.of_request(request, DEFAULT_LADDER), now, others_wait=others_wait
        )
    except Overloaded as error:
        return error.retry_after_s == ACTIVE_S
    return False
