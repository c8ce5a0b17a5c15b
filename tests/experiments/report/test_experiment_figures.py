"""The figures of an experiment: which are drawn, and what their titles say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.experiments.report.made_up_results import write_run
from tigas_experiments.report.experiment_figures import bandwidth, latencies, over_rtt, overview, profiles
from tigas_experiments.report.groups import Groups
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
    assert plot.title == "Mean frame age at 20 ms round trip: Latency 50 ms; at 300 ms: Latency 330 ms"
    assert "Means over 2 runs" in plot.caption


def test_a_caption_says_what_is_taken_together(tmp_path: Path) -> None:
    plot = overview(groups(tmp_path, {}, {"movement": "orbit"}, {"movement": "orbit", "repeat": 1}))
    assert plot is not None
    assert "at its lowest round trip (20 ms). Means over 3 runs (2 movements), from the least to" in plot.caption


def test_runs_over_an_unshaped_network_without_pictures_or_rungs(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", "budget", "unshaped", None, mode="dash-tuned")
    for name in ("link", "quality"):
        (path / f"{name}.ndjson").write_text("")
    one = Groups.of(load(tmp_path).runs)
    assert profiles(one, "unshaped") is None
    plot = bandwidth(one, "unshaped")
    assert plot is not None
    assert plot.title == "Received: DASH tuned 2.0 MB"


@pytest.mark.parametrize(
    ("link_kbps", "words"),
    [
        (80_000, "the scene's 10.0 MB would have been downloaded after 1.0 s"),
        (8000, "of the scene's 10.0 MB, 20 % could have been downloaded in that time"),
    ],
)
def test_streaming_is_held_against_downloading(tmp_path: Path, link_kbps: float, words: str) -> None:
    plot = bandwidth(groups(tmp_path, {"link_kbps": link_kbps, "kbps": 4000}), "bus")
    assert plot is not None
    assert plot.title == f"Received: Latency 1.0 MB; {words}"


def test_the_overview_names_the_best_and_the_worst(tmp_path: Path) -> None:
    runs: list[dict[str, Any]] = [{"controller": "latency", "delay_ms": 130}, {"controller": "budget"}]
    plot = overview(groups(tmp_path, *runs))
    assert plot is not None
    assert plot.title == "Budget has the most inputs within 108 ms, 100.0 % on average; Latency the fewest, 0.0 %"
