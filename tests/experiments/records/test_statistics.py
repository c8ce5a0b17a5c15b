"""Figures against records worked by hand, some of them in `figures.golden.json`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from tests.experiments.made_up import frame, inputs, late, reply
from tigas_common.wire.render import ServerTiming
from tigas_experiments.records import statistics
from tigas_experiments.records.statistics import IN_TIME
from tigas_experiments.wire.recording import Fate, Input, Reply, Request, Traffic

GOLDEN: dict[str, Any] = json.loads(Path(__file__).with_name("figures.golden.json").read_text())


def times(name: str, **statistics: float | None) -> dict[str, float | None]:
    return {f"{name}_{statistic}_ms": ms for statistic, ms in statistics.items()}


@pytest.mark.parametrize(
    ("values", "rank", "expected"),
    [([], 0.5, None), ([7.0], 0.99, 7.0), ([4.0, 1.0, 3.0, 2.0], 0.5, 2.0), (list(range(1, 101)), 0.95, 95)],
)
def test_percentiles_are_nearest_rank(values: list[float], rank: float, expected: float | None) -> None:
    assert statistics.percentile(values, rank) == expected


def test_an_input_is_answered_by_the_first_frame_of_its_pose_or_a_later_one() -> None:
    sampled = inputs(4, every_ms=10)  # poses 1 to 4 at 0, 10, 20, 30 ms
    shown = [frame(25, 0), frame(50, 2), frame(60, 1), frame(90, 3)]
    assert statistics.answer_times(sampled, shown) == [50, 40, 70, math.inf]


def test_unanswered_inputs_are_slower_than_any() -> None:
    sampled = inputs(10)
    found = statistics.latencies(sampled, late(sampled[:9], 40))
    assert (found["inputs"], found["inputs_unanswered"]) == (10, 1)
    assert (found["motion_to_photon_p50_ms"], found["motion_to_photon_p95_ms"]) == (40, math.inf)
    assert found[IN_TIME] == 90


def test_a_stalled_page_s_missed_poses_are_late_and_no_rest_of_the_viewer() -> None:
    """There were no samples from 500 to 1400 ms: poses 26 to 69 were due in between, and shown with pose 70."""
    whole = inputs(100)
    stalled = [
        entry.model_copy(update={"missed": True, "pose": 71}) if 500 <= entry.at < 1400 else entry for entry in whole
    ]
    shown = late([entry for entry in stalled if not entry.missed], 40)
    found = statistics.latencies(stalled, shown)
    assert (found["inputs"], found["inputs_missed"], found["inputs_unanswered"]) == (100, 45, 0)
    assert (found["motion_to_photon_p50_ms"], found["motion_to_photon_p99_ms"]) == (40, 920)
    sampled = [entry for entry in stalled if not entry.missed]
    assert statistics.latencies(sampled, shown)["motion_to_photon_p99_ms"] == 40, "what it would say without them"
    assert len(statistics.freezes(stalled, shown, 2100)) == 1
    assert statistics.freezes(sampled, shown, 2100) == []


def test_the_display_s_interval_is_the_frame_less_and_the_frame_more() -> None:
    sampled = inputs(4)
    shown = [frame(entry.at + ms, entry.pose) for entry, ms in zip(sampled, (95, 105, 110, 117), strict=True)]
    found = statistics.latencies(sampled, shown, 1000 / 120)
    shares = ("inputs_within_a_frame_less_pct", IN_TIME, "inputs_within_a_frame_more_pct")
    assert [found[name] for name in shares] == [25, 50, 75]


def test_requests_are_counted_by_what_became_of_them() -> None:
    fates: tuple[Fate, ...] = ("shown", "shown", "overtaken", "cancelled", "dropped", "dropped", "unanswered")
    sent = [Request(at=20.0 * number, pose=number, asked_rung=2, fate=fate) for number, fate in enumerate(fates)]
    expected = {"sent": 7, "shown": 2, "overtaken": 1, "cancelled": 1, "dropped": 2, "unanswered": 1}
    assert statistics.requests(sent) == {f"requests_{name}": count for name, count in expected.items()}
    assert statistics.requests([]) == {}, "DASH, or nobody recorded them"


def test_nobody_moved() -> None:
    found = statistics.latencies([], [frame(10, 1)])
    assert (found["inputs"], found["motion_to_photon_p50_ms"], found[IN_TIME]) == (0, None, None)


def test_a_frame_s_age_is_that_of_its_own_pose_and_skips_what_no_frame_was_asked_for() -> None:
    sampled = inputs(4, every_ms=10)  # poses 1 to 4 at 0, 10, 20, 30 ms
    shown = [frame(5, 0), frame(50, 2), frame(60, 2), frame(70, 1), frame(130, 4), frame(200, 9)]
    assert statistics.new_view_ages(sampled, shown) == [(50, 40), (130, 100)]
    assert statistics.frame_ages(sampled, shown) == times("frame_age", mean=70, p50=40, p95=100)
    assert statistics.frame_ages(sampled, []) == times("frame_age", mean=None, p50=None, p95=None)


def test_content_ages_grow_while_the_picture_stands_and_the_viewer_moves() -> None:
    """Poses 1 to 4 at 0, 20, 40 and 60 ms; then the viewer rests. Pose 1 is shown from 30 ms, pose 4 from 80 ms on."""
    sampled = inputs(4, every_ms=20)
    shown = [frame(30, 1), frame(80, 4)]
    found = statistics.content_ages(sampled, shown, duration_ms=100, interval_ms=20)
    # At 0, 5, … 25 ms the viewer has left the first picture for 20, 25, … 45 ms; at 30, … 75 ms pose 1 for 30, … 75 ms.
    ages = [20, 25, 30, 35, 40, 45, *range(30, 80, 5), 0, 0, 0, 0]
    assert found == times("content_age", mean=sum(ages) / 20, p50=35, p95=70)


def test_a_frozen_picture_ages_until_the_end_and_a_resting_viewer_s_never() -> None:
    sampled = inputs(50)
    ages = [statistics.content_ages(sampled, shown, 40_000) for shown in ([], late(sampled, 40))]
    frozen, followed = (each["content_age_p95_ms"] for each in ages)
    assert frozen is not None
    assert frozen > 9_000
    assert followed == 0, "the viewer rests after a second"
    assert statistics.content_ages([], [], 10_000) == times("content_age", mean=None, p50=None, p95=None)


def test_a_turned_picture_answers_an_input_before_its_content_does() -> None:
    sampled = inputs(3)  # poses 1 to 3 at 0, 20, 40 ms
    shown = [frame(16, 0, view=1), frame(36, 0, view=2), frame(60, 2, view=2), frame(300, 3)]
    assert statistics.answer_times(sampled, shown, statistics.view_pose) == [16, 16, 260]
    assert statistics.answer_times(sampled, shown) == [60, 40, 260]
    assert statistics.view_latencies(sampled, shown[:2])["view_latency_p95_ms"] == math.inf
    assert statistics.frame_ages(sampled, shown)["frame_age_p95_ms"] == 260, "of its content"


def test_a_picture_that_turns_is_no_freeze_and_no_new_view() -> None:
    """Content comes once, and 50 times the viewer turns."""
    sampled = inputs(50)
    turned = [frame(entry.at + 16, 1, view=entry.pose) for entry in sampled]
    stood = [frame(entry.at + 16, 1) for entry in sampled]
    assert [statistics.rates(shown, 1000)["new_views_per_s"] for shown in (turned, stood)] == [1, 1]
    assert statistics.freezes(sampled, turned, 1100) == []
    assert len(statistics.freezes(sampled, stood, 1100)) == 1


def test_what_the_newest_frame_does_not_cover_counts_by_time() -> None:
    shown = [frame(0, 1), frame(100, 1, view=2, filled=0.4), frame(200, 1, view=3, filled=0.1), frame(900, 9, filled=1)]
    assert statistics.filled_share(shown, 500) == pytest.approx((0.4 * 100 + 0.1 * 300) / 400)
    assert statistics.filled_share(shown[:1], 500) is None, "nothing was turned"


def test_a_response_takes_from_the_request_to_the_last_byte() -> None:
    found = statistics.response_times([reply(-1, 500), reply(0, 30), reply(40, 50), reply(70, 100)])
    assert found == times("response_time", mean=60, p50=50, p95=100), "the first was asked for before the run"
    assert statistics.response_times([]) == times("response_time", mean=None, p50=None, p95=None)


def test_rendering_time_is_the_server_s_where_it_tells() -> None:
    def rendered(at: float, ms: float | None) -> Reply:
        server = None if ms is None else ServerTiming(queue=9, render=ms, encode=9)
        return reply(at, 30).model_copy(update={"server": server})

    before, untold = rendered(-1, 99), rendered(80, None)
    told = [before, rendered(0, 4), rendered(20, 20), rendered(40, 6)]
    assert statistics.render_times([*told, untold]) == times("render", mean=10, p50=6)
    assert statistics.render_times([untold]) == times("render", mean=None, p50=None)


def test_constant_latency_is_no_freeze_however_long() -> None:
    sampled = inputs(100)
    before = [frame(at, 0) for at in range(10, 2000, 20)]  # the pose of the time before the run
    assert statistics.freezes(sampled, [*before, *late(sampled, 2000)], 4000) == []


def test_standing_still_is_no_freeze() -> None:
    sampled = [*inputs(50), *inputs(50, start=5000, first=51)]
    assert statistics.freezes(sampled, late(sampled, 80), 6100) == []


def test_a_gap_while_the_viewer_moves_is_a_freeze() -> None:
    sampled = inputs(100)
    shown = late(sampled, 40)
    held = [frame(1400, entry.pose) if 500 <= entry.at < 1360 else f for entry, f in zip(sampled, shown, strict=True)]
    found = statistics.freezes(sampled, held, 2100)
    # The previous view arrived at 520 ms, for the input at 480 ms; the next input was due 20 ms later.
    assert found == [1400 - 520 - 20]


def test_a_picture_that_never_comes_back_is_a_freeze_until_the_end() -> None:
    sampled = inputs(100)
    found = statistics.freezes(sampled, late(sampled[:50], 40), 6000)
    assert found == [6000 - (980 + 40) - 20]
    assert statistics.freezes(sampled, [], 6000) == [6000]


def test_a_repeated_frame_is_no_new_view() -> None:
    shown = [frame(10, 1), frame(20, 1), frame(30, 2), frame(40, 2), frame(1500, 3)]
    assert statistics.rates(shown, 1000) == {"frames_per_s": 4, "new_views_per_s": 2}


def test_rungs_and_height_are_weighted_by_time() -> None:
    shown = [frame(0, 1, rung=2, height=360), frame(750, 2, rung=0, height=720)]
    assert statistics.rungs(shown, 1000) == {0: 0.25, 2: 0.75}
    assert statistics.rung_changes(shown, 1000) == 1
    assert statistics.mean_height(shown, 1000) == 0.75 * 360 + 0.25 * 720
    assert (statistics.median_height(shown, 1000), statistics.median_height(shown, 3000)) == (360, 720)
    assert statistics.median_height([], 1000) is None
    assert statistics.rungs([frame(0, 1, rung=None)], 1000) == {}
    assert statistics.mean_height([], 1000) is None


def test_received_rate() -> None:
    traffic = [Traffic(at=0, bytes=1000), Traffic(at=1000, bytes=126_000), Traffic(at=2000, bytes=10**9)]
    assert statistics.received_kbps(traffic, 1500) == 1000
    assert statistics.received_kbps(traffic[:1], 1500) is None


def test_mean_over_time_weights_by_how_long_a_sample_covers() -> None:
    assert statistics.mean_over_time([(0, 99), (100, 10), (400, 20)]) == (100 * 10 + 300 * 20) / 400
    assert statistics.mean_over_time([(0, 5)]) is None


def test_the_parts_of_a_frames_age_add_up_to_it() -> None:
    (sampled,) = inputs(1, start=100.0)
    answer = reply(asked_at=104.0, took_ms=40.0, pose=sampled.pose)
    shown = frame(160.0, sampled.pose)
    parts = statistics.age_parts([sampled], [shown, frame(176.0, sampled.pose)], [answer])
    assert parts == {"wait": 4, "queue": 0, "render": 11, "encode": 1, "network": 28, "enhance": 0, "page": 16}
    assert sum(parts.values()) == 160 - 100
    for took, expected in ((6.5, (6.5, 9.5)), (99.0, (16.0, 0.0))):
        enhanced = shown.model_copy(update={"enhance_ms": took})
        parts = statistics.age_parts([sampled], [enhanced], [answer])
        assert (parts["enhance"], parts["page"]) == expected


def test_frames_whose_reply_is_unknown_have_no_parts() -> None:
    sampled = inputs(3)
    answers = [reply(sampled[0].at, 30.0, sampled[0].pose), reply(sampled[2].at, 30.0, sampled[2].pose)]
    shown = [frame(50.0, sampled[0].pose), frame(70.0, sampled[1].pose), frame(72.0, sampled[0].pose)]
    assert statistics.age_parts(sampled, shown, answers)["page"] == 20
    assert statistics.age_parts(sampled, shown[1:2], answers) == {}
    silent = [answer.model_copy(update={"server": None}) for answer in answers]
    assert statistics.age_parts(sampled, shown, silent) == {}


@pytest.mark.parametrize("name", GOLDEN)
def test_the_figures_of_records_worked_by_hand(name: str) -> None:
    case = GOLDEN[name]
    duration = case["duration_ms"]
    inputs = [Input(at=at, pose=pose, position=(0, 0, 0), quaternion=(0, 0, 0, 1)) for at, pose in case["inputs"]]
    frames = [frame(*of) for of in case["frames"]]
    found = {
        **statistics.latencies(inputs, frames),
        **statistics.view_latencies(inputs, frames),
        **statistics.content_ages(inputs, frames, duration),
        **statistics.rates(frames, duration),
        "mean_height": statistics.mean_height(frames, duration),
        "switches": statistics.rung_changes(frames, duration),
        "received_kbps": statistics.received_kbps([Traffic(at=at, bytes=n) for at, n in case["traffic"]], duration),
    }
    expected = {name: math.inf if value == "never" else value for name, value in case["figures"].items()}
    assert {name: found[name] for name in expected} == pytest.approx(expected)
