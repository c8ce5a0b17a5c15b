"""The figures of an experiment: which are drawn, and their captions."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.experiments.report.synthetic_results import groups
from tigas_experiments.report.figures import latency_parts, over_rtt, overview, profiles
from tigas_experiments.report.metrics import METRICS


def test_round_trips_are_compared_if_there_are_several(tmp_path: Path) -> None:
    assert over_rtt(groups(tmp_path / "one", {}, {"controller": "seen"}), "bus") is None
    runs = [{"rtt_ms": rtt, "delay_ms": 30 + rtt, "repeat": n} for rtt in (20.0, 50.0, 300.0) for n in (0, 1)]
    plot = over_rtt(groups(tmp_path / "three", *runs), "bus")
    assert plot is not None
    assert "Means over 2 runs" in plot.caption


def test_an_overview_is_at_the_lowest_round_trip(tmp_path: Path) -> None:
    plot = overview(groups(tmp_path, {}, {"rtt_ms": 300.0}))
    assert plot is not None
    assert plot.caption == "Each controller over each network, at its lowest round trip (20 ms). One run."


def test_streams_without_rungs_have_no_profiles(tmp_path: Path) -> None:
    assert profiles(groups(tmp_path, {"mode": "dash-tuned"}), "bus") is None


def test_the_parts_of_the_frame_age_are_stacked_by_controller_and_network(tmp_path: Path) -> None:
    every = groups(
        tmp_path,
        *(
            {"controller": name, "network": network, "delay_ms": took + 16, "reply_ms": took}
            for name, took in (("latency", 60.0), ("seen", 30.0))
            for network in ("bus", "train")
        ),
        {"mode": "dash-edge", "delay_ms": 80},
    )
    plot = latency_parts(every)
    assert plot is not None
    for text in ("Rendering", "Encoding", "Latency, train"):
        assert text in plot.svg
    assert "DASH" not in plot.svg, "it has no server times"
    parts = [METRICS[name] for name in ("age_network_ms", "age_page_ms", "age_render_ms")]
    means = [
        [found.mean for metric in parts if (found := group.estimate(metric))]
        for group in every
        if group.controller.name == "latency"
    ]
    assert means == [pytest.approx([60 - 12, 16, 11])] * 2
    assert latency_parts(groups(tmp_path / "without replies", {})) is None
