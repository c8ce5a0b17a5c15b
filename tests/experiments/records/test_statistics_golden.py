"""The lab's figures against records worked by hand, which also test the page's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.experiments.made_up import frame
from tigas_experiments.records import statistics
from tigas_experiments.wire.recording import Input, Traffic

GOLDEN: dict[str, Any] = json.loads(Path(__file__).with_name("figures.golden.json").read_text())


@pytest.mark.parametrize("name", GOLDEN)
def test_the_figures_of_records_worked_by_hand(name: str) -> None:
    case = GOLDEN[name]
    duration = case["duration_ms"]
    inputs = [Input(at=at, pose=pose, position=(0, 0, 0), quaternion=(0, 0, 0, 1)) for at, pose in case["inputs"]]
    frames = [frame(*of) for of in case["frames"]]
    latencies = statistics.latencies(inputs, frames)
    views = statistics.view_latencies(inputs, frames)
    assert case["figures"] == {
        "p50": latencies.p50,
        "p90": latencies.p90,
        "p95": latencies.p95,
        "p99": latencies.p99,
        "view_p50": views.p50,
        "view_p95": views.p95,
        "share_interactive": latencies.share_interactive,
        "share_frame_less": latencies.share_frame_less,
        "share_frame_more": latencies.share_frame_more,
        "content_age_mean": pytest.approx(statistics.content_ages(inputs, frames, duration).mean),
        "new_views_per_s": statistics.rates(frames, duration).new_views_per_s,
        "mean_height": statistics.mean_height(frames, duration),
        "switches": statistics.rungs(frames, duration).switches,
        "received_kbps": statistics.received_kbps([Traffic(at=at, bytes=n) for at, n in case["traffic"]], duration),
    }
