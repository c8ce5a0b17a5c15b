"""Groups of runs with known figures."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.experiments.report.synthetic_results import download, write_run
from tigas_experiments.report.groups import Groups, Spread, overall
from tigas_experiments.report.metrics import IN_TIME, METRICS
from tigas_experiments.report.results import load
from tigas_experiments.report.tables import overall_markdown
from tigas_experiments.report.warnings import warnings


def test_a_time_that_never_came_is_no_time(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", delay_ms=40)
    frames = (path / "frames.ndjson").read_text().splitlines(keepends=True)
    (path / "frames.ndjson").write_text("".join(frames[:60]))
    write_run(tmp_path / "runs" / "b", delay_ms=40, repeat=1)
    (group,) = Groups.of(load(tmp_path).runs)
    p95, in_time = group.spread(METRICS["motion_to_photon_p95_ms"]), group.spread(METRICS[IN_TIME])
    assert p95 is not None
    assert (p95.low, p95.mean) == (40, math.inf)
    assert in_time is not None
    assert in_time.mean == pytest.approx((60 + 100) / 2)


def test_nobody_moved_and_nothing_came(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a")
    for name in ("inputs", "frames", "traffic", "link", "quality"):
        (path / f"{name}.ndjson").write_text("")
    (group,) = Groups.of(load(tmp_path).runs)
    assert group.spread(METRICS["motion_to_photon_p50_ms"]) is None
    assert group.spread(METRICS["mean_height_px"]) is None


def test_a_spread_leaves_out_runs_that_lack_the_figure() -> None:
    assert Spread.over([None, 3.0, None]) == Spread(3.0, 3.0, 3.0, 1)
    assert Spread.over([None]) is None


def test_a_repeat_counts_within_its_block_alone(tmp_path: Path) -> None:
    for name, (movement, delay) in enumerate((("a", 40), ("a", 60), ("b", 110))):
        write_run(tmp_path / "runs" / f"{name}", movement=movement, delay_ms=delay)
    (group,) = Groups.of(load(tmp_path).runs)
    spread, estimate = group.spread(METRICS["frame_age_mean_ms"]), group.estimate(METRICS["frame_age_mean_ms"])
    assert spread is not None
    assert estimate is not None
    assert (spread.mean, spread.low, spread.high, spread.runs) == (80, 40, 110, 3)
    assert (estimate.mean, estimate.blocks) == (80, 2)


def test_the_mean_of_equal_values_is_one_of_them() -> None:
    assert sum([0.1] * 6) / 6 < 0.1, "else there is nothing to test"
    spread = Spread.over([0.1] * 6)
    assert spread is not None
    assert spread.low == spread.mean == spread.high


def write_runs(folder: Path, *delays: tuple[str, str, float, float]) -> None:
    """Runs by controller, network, round trip and delay, all in milliseconds."""
    for number, (controller, network, rtt, delay) in enumerate(delays):
        write_run(folder / "runs" / f"{number:02}", controller, network, rtt, delay_ms=delay)


def test_each_network_counts_the_same(tmp_path: Path) -> None:
    write_runs(
        tmp_path,
        ("budget", "bus", 20, 40),
        ("budget", "bus", 20, 60),
        ("budget", "tram", 20, 110),
        ("latency", "bus", 20, 90),
        ("latency", "tram", 20, 90),
    )
    latency, budget = overall(Groups.of(load(tmp_path).runs))
    spread = budget.spread(METRICS["frame_age_mean_ms"])
    assert spread is not None
    assert (spread.mean, spread.low, spread.high) == (80, 50, 110)
    assert (latency.controller.title, latency.runs, budget.runs) == ("Latency", 2, 3)
    first, _, row, *_ = overall_markdown([budget]).splitlines()
    assert first.startswith("| round trip, ms | controller | runs | View latency p95, ms |")
    assert row.startswith("| 20 | Budget | 3 | 80 | 80 | ")


def test_groups_of_one_network_have_the_same_blocks(tmp_path: Path) -> None:
    """Budget is the later one in every block, but was not measured in the hard ones."""
    for number in range(8):
        hard = number >= 4
        delay = 200.0 if hard else 40.0
        write_run(tmp_path / "runs" / f"l{number}", "latency", "bus", movement=f"{number}", delay_ms=delay)
        if not hard:
            write_run(tmp_path / "runs" / f"b{number}", "budget", "bus", movement=f"{number}", delay_ms=delay + 10)
    results = load(tmp_path)
    latency, budget = Groups.of(results.runs)
    means = [spread.mean for group in (latency, budget) if (spread := group.spread(METRICS["frame_age_mean_ms"]))]
    assert means == [40, 50]
    left_out = (
        "Tables and figures leave out 4 of 12 runs, because not all controllers have runs of their blocks: "
        "Budget lacks 4."
    )
    assert left_out in warnings(results, {})


def test_controllers_without_a_common_block_are_shown_with_a_warning(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a", "latency", "bus", movement="a")
    write_run(tmp_path / "runs" / "b", "budget", "bus", movement="b")
    results = load(tmp_path)
    assert len(Groups.of(results.runs)) == 2
    (warning,) = (each for each in warnings(results, {}) if "no block has runs of all controllers" in each)
    assert warning.endswith("(Latency lacks 1, Budget lacks 1).")


def test_what_not_all_networks_have_is_left_out(tmp_path: Path) -> None:
    write_runs(
        tmp_path,
        ("budget", "bus", 20, 40),
        ("budget", "bus", 300, 40),
        ("latency", "bus", 20, 40),
        ("budget", "tram", 20, 40),
        ("l2a|\n", "tram", 20, 40),
    )
    assert [(row.rtt_ms, row.controller.title) for row in overall(Groups.of(load(tmp_path).runs))] == [(20, "Budget")]


def test_a_download_s_times_are_figures_of_its_runs_and_of_no_others(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "0", "budget")
    write_run(tmp_path / "runs" / "1", mode="local-compressed", local=download(0.5, None))
    of_pictures, of_download = Groups.of(load(tmp_path).runs)
    first, whole = METRICS["first_picture_s"], METRICS["whole_scene_s"]
    assert of_pictures.spread(first) is None
    assert [of_download.blocks(metric).popitem()[1] for metric in (first, whole)] == [0.5, math.inf]


def test_an_earlier_download_of_a_plain_ply_is_still_read(tmp_path: Path) -> None:
    local = download(0.5, 1.5).model_copy(update={"form": "ply"})
    write_run(tmp_path / "runs" / "0", mode="local-ply", local=local)
    (group,) = Groups.of(load(tmp_path).runs)
    assert group.controller.title == "Local PLY"
