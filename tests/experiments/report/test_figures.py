"""The figures of an experiment: which are drawn, and their captions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.experiments.report.synthetic_results import write_run
from tigas_experiments.report.figures import (
    bandwidth,
    heights_over_time,
    latencies,
    latency_parts,
    over_rtt,
    overview,
    profiles,
)
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.report.results import load


def groups(folder: Path, *runs: dict[str, Any]) -> Groups:
    """The groups of runs."""
    for number, run in enumerate(runs):
        write_run(folder / "runs" / f"{number:02}", **run)
    return Groups.of(load(folder).runs)


def test_one_round_trip_needs_no_figure_of_round_trips(tmp_path: Path) -> None:
    two = groups(tmp_path, {}, {"controller": "budget"})
    assert over_rtt(two, "bus") is None
    assert latencies(two, "bus") is not None


def test_round_trips_are_told_from_end_to_end(tmp_path: Path) -> None:
    runs = [{"rtt_ms": rtt, "delay_ms": 30 + rtt, "repeat": n} for rtt in (20.0, 50.0, 300.0) for n in (0, 1)]
    plot = over_rtt(groups(tmp_path, *runs), "bus")
    assert plot is not None
    assert "Means over 2 runs" in plot.caption


def test_a_caption_says_what_is_taken_together(tmp_path: Path) -> None:
    plot = overview(groups(tmp_path, {}, {"movement": "orbit"}, {"movement": "orbit", "repeat": 1}))
    assert plot is not None
    assert "at its lowest round trip (20 ms). Means over 3 runs (2 movements), with their range." in plot.caption


def test_runs_over_an_unshaped_network_without_pictures_or_rungs(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", "budget", "unshaped", None, mode="dash-tuned")
    for name in ("link", "quality"):
        (path / f"{name}.ndjson").write_text("")
    one = Groups.of(load(tmp_path).runs)
    assert profiles(one, "unshaped") is None
    plot = bandwidth(one, "unshaped")
    assert plot is not None
    assert "DASH tuned" in plot.svg


def test_the_bandwidth_figure_compares_with_downloading_the_scene(tmp_path: Path) -> None:
    fast = bandwidth(groups(tmp_path / "fast", {"link_kbps": 80_000, "kbps": 4000}), "bus")
    slow = bandwidth(groups(tmp_path / "slow", {"link_kbps": 8000, "kbps": 4000}), "bus")
    assert fast is not None
    assert slow is not None
    assert "Full link rate" in slow.svg
    assert ("Scene file" in fast.svg, "Scene file" in slow.svg) == (True, False)


def test_the_parts_of_the_frame_age_are_stacked_by_controller_and_network(tmp_path: Path) -> None:
    for name, took in (("latency", 60.0), ("budget", 30.0)):
        for network in ("bus", "train"):
            write_run(tmp_path / "runs" / f"{name}-{network}", name, network, delay_ms=took + 16, reply_ms=took)
    write_run(tmp_path / "runs" / "dash", network="bus", mode="dash-edge", delay_ms=80)
    every = Groups.of(load(tmp_path).runs)
    plot = latency_parts(every)
    assert plot is not None
    for text in ("Rendering", "Encoding", "Latency, train"):
        assert text in plot.svg
    assert "DASH" not in plot.svg, "it has no server times"
    means = [
        [
            spread.mean
            for name in ("age_network_ms", "age_page_ms", "age_render_ms")
            if (spread := g.spread(METRICS[name]))
        ]
        for g in every
        if g.controller.name == "latency"
    ]
    assert means == [pytest.approx([60 - 12, 16, 11])] * 2


def test_without_replies_there_are_no_parts(tmp_path: Path) -> None:
    assert latency_parts(groups(tmp_path, {})) is None


def test_the_resolution_over_time_is_of_each_controller_s_first_run(tmp_path: Path) -> None:
    runs: list[dict[str, Any]] = [{"rungs": (1, 3), "hold": 50}, {"repeat": 1, "rungs": (0,)}, {"controller": "l2a"}]
    plot = heights_over_time(groups(tmp_path, *runs), "bus")
    assert plot is not None
    assert plot.caption == "Over bus at 20 ms round trip, first run of each controller."


def test_one_run_is_not_one_each(tmp_path: Path) -> None:
    plot = overview(groups(tmp_path, {}))
    assert plot is not None
    assert plot.caption.endswith(" One run.")
