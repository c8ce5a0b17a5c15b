"""Parts of a frame's age: they add up to it."""

from __future__ import annotations

from dataclasses import asdict

from tests.experiments.made_up import frame, inputs, reply
from tigas_experiments.report.latency_parts import LatencyParts


def test_the_parts_of_a_frames_age_add_up_to_it() -> None:
    (sampled,) = inputs(1, start=100.0)
    answer = reply(asked_at=104.0, took_ms=40.0, pose=sampled.pose)
    parts = LatencyParts.of([sampled], [frame(160.0, sampled.pose), frame(176.0, sampled.pose)], [answer])
    assert parts is not None
    assert asdict(parts) == {"wait": 4, "queue": 0, "render": 11, "encode": 1, "network": 28, "enhance": 0, "page": 16}
    assert sum(asdict(parts).values()) == 160 - 100


def test_enhancement_is_a_part_of_its_own() -> None:
    (sampled,) = inputs(1, start=100.0)
    answer = reply(asked_at=104.0, took_ms=40.0, pose=sampled.pose)
    for took, expected in ((6.5, (6.5, 9.5)), (99.0, (16.0, 0.0))):
        shown = frame(160.0, sampled.pose).model_copy(update={"enhance_ms": took})
        parts = LatencyParts.of([sampled], [shown], [answer])
        assert parts is not None
        assert (parts.enhance, parts.page) == expected


def test_frames_whose_reply_is_unknown_do_not_count() -> None:
    sampled = inputs(3)
    answers = [reply(sampled[0].at, 30.0, sampled[0].pose), reply(sampled[2].at, 30.0, sampled[2].pose)]
    shown = [frame(50.0, sampled[0].pose), frame(70.0, sampled[1].pose), frame(72.0, sampled[0].pose)]
    parts = LatencyParts.of(sampled, shown, answers)
    assert parts is not None
    assert parts.page == 20
    assert LatencyParts.of(sampled, shown[1:2], answers) is None
    silent = [answer.model_copy(update={"server": None}) for answer in answers]
    assert LatencyParts.of(sampled, shown, silent) is None
