"""The CSV files of runs with known figures."""

from __future__ import annotations

import csv
import math
import statistics
from pathlib import Path

import pytest

from tests.experiments.report.synthetic_results import SCENE_BYTES, change, rows, write_run
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.run_table import load_results
from tigas_experiments.report.tables import best_rows, write_csv


def written(folder: Path) -> Path:
    """The folder, with CSV files on its runs against the first controller."""
    results = load_results(folder)
    groups = Groups.from_runs(results.runs)
    write_csv(results, groups, groups.against(next(iter(groups.looks))), [], folder)
    return folder


def test_a_row_of_runs_csv_has_every_field_and_figure(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "a"
    write_run(folder, "seen", "bus", 50.0, delay_ms=80, reply_ms=60, rungs=(1, 3), hold=50, kbps=4000, repeat=2)
    write_run(tmp_path / "runs" / "b", 2, "bus", None, every=2, delay_ms=120)
    one, two = rows(written(tmp_path) / "runs.csv")
    expected = {
        "folder": "a",
        "status": "complete",
        "network": "bus",
        "rtt_ms": "50.0",
        "controller": "seen",
        "configuration_scene": "courtyard",
        "configuration_movement": "stroll",
        "configuration_network_trace": "bus",
        "configuration_mode": "stateless",
        "configuration_profile": "seen",
        "configuration_repeat": "2",
        "configuration_duration_s": "2.0",
        "scene_bytes": str(SCENE_BYTES),
        "processors_usable": "",
        "saturated": "False",
        "pegged_thread_of": "",
        "pegged_thread_pct": "",
        "services_watched": "",
    }
    assert {name: one[name] for name in expected} == expected
    share = 1000 / 1920
    """Rung 1 from 80 ms to 1080 ms, then rung 3 until 2000 ms."""
    figures = {
        "motion_to_photon_p50_ms": 80,
        "motion_to_photon_p95_ms": 80,
        "inputs": 100,
        "inputs_unanswered": 0,
        "inputs_within_108ms_pct": 100,
        "frame_age_mean_ms": 80,
        "frame_age_p95_ms": 80,
        "response_time_mean_ms": 60,
        "response_time_p50_ms": 60,
        "response_time_p95_ms": 60,
        "new_views_per_s": 97 / 2,  # the last three come after the movement's end
        "received_mbit_s": 4,
        "over_link_mbit_s": 4,
        "link_mbit_s": 20,
        "profile_changes_per_min": 1 * 30,  # one in two seconds
        "picture_ssim": 0.9,
        "view_psnr_db": 20,
        "seen_psnr_db": 20,
        "content_age_p50_ms": 80 - 20 + 1000 / 60 + 5,  # left after 20 ms, in frames of 60 Hz, every 5 ms
        "profile_1_pct": 100 * share,
        "mean_profile": share * 1 + (1 - share) * 3,
        "mean_height_px": share * 720 + (1 - share) * 240,
    }
    assert {name: float(one[name]) for name in figures} == pytest.approx(figures)
    assert (two["controller"], two["rtt_ms"], two["profile_1_pct"]) == ("profile-2", "", "")
    assert float(two["motion_to_photon_p50_ms"]) == 120, "every second input is answered by a frame of its own"
    assert float(two["motion_to_photon_p95_ms"]) == 140, "the others by the next one's"
    assert float(two["frame_age_p95_ms"]) == 120, "a frame's own"
    assert two["response_time_p95_ms"] == "", "nobody recorded replies"


def test_a_group_has_mean_range_and_interval_over_its_blocks(tmp_path: Path) -> None:
    delays = (40.0, 50.0, 90.0, 60.0, 60.0, 60.0) * 2
    for number, delay in enumerate(delays):
        for repeat in (0, 1):
            folder = tmp_path / "runs" / f"{number:02}-{repeat}"
            write_run(folder, delay_ms=delay, offset_s=10.0 * number, repeat=repeat)
    write_run(tmp_path / "runs" / "other", delay_ms=70, rtt_ms=100, busy=1.0)
    one, other = rows(written(tmp_path) / "groups.csv")
    names = ("network", "rtt_ms", "controller", "runs", "blocks", "runs_saturated")
    assert [one[name] for name in names] == ["bus", "20.0", "latency", "24", "12", "0"]
    assert [float(one[f"frame_age_mean_ms_{name}"]) for name in ("mean", "min", "max")] == [60, 40, 90]
    low, high = (float(one[f"frame_age_mean_ms_ci95_{end}"]) for end in ("low", "high"))
    # As many independent runs would have an interval narrower by a factor of the square root of two.
    half = 2.201 * statistics.stdev(delays) / math.sqrt(len(delays))
    assert (low, high) == pytest.approx((60 - half, 60 + half), abs=0.1)
    assert [other[name] for name in names] == ["bus", "100.0", "latency", "1", "1", "1"]
    assert other["frame_age_mean_ms_ci95_low"] == ""


def test_differences_csv_has_each_figure_against_the_baseline(tmp_path: Path) -> None:
    for number in range(12):
        offset_s, delay_ms = 10.0 * number, 40.0 + 10 * number
        write_run(tmp_path / "runs" / f"l{number}", "latency", delay_ms=delay_ms + 20, offset_s=offset_s)
        write_run(tmp_path / "runs" / f"b{number}", "seen", delay_ms=delay_ms, offset_s=offset_s)
    found = {row["figure"]: row for row in rows(written(tmp_path) / "differences.csv")}
    row = found["frame_age_mean_ms"]
    names = ("network", "rtt_ms", "controller", "baseline", "blocks")
    assert [row[name] for name in names] == ["bus", "20.0", "seen", "latency", "12"]
    ends = [float(row[name]) for name in ("difference", "ci95_low", "ci95_high")]
    assert ends == pytest.approx([-20, -20.5, -19.5]), "blocks differ by far more than controllers do in each of them"
    assert found["response_time_mean_ms"]["difference"] == "", "nobody recorded replies"


def test_a_row_says_whether_its_run_is_in_tables_and_figures_and_which_thread_was_busy(tmp_path: Path) -> None:
    for controller, movement in (("latency", "stroll"), ("seen", "stroll"), ("seen", "orbit")):
        write_run(tmp_path / "runs" / f"{controller}-{movement}", controller, movement=movement)
    change(tmp_path / "runs" / "latency-stroll", load={"pegged": {"chromium renderer": 0.34, "tigas render": 0.2}})
    (write_run(tmp_path / "runs" / "x") / "frames.ndjson").unlink()
    found = rows(written(tmp_path) / "runs.csv")
    assert {row["folder"]: row["compared"] for row in found} == {
        "seen-orbit": "False",
        "seen-stroll": "True",
        "latency-stroll": "True",
        "x": "",
    }
    assert next((row["pegged_thread_of"], row["pegged_thread_pct"]) for row in found) == ("chromium renderer", "34.0")


@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t", "\r"])
def test_text_that_would_be_a_formula_is_marked_as_text_and_numbers_are_not(tmp_path: Path, start: str) -> None:
    name = f"{start}cmd|' /C calc'!A0"
    write_run(tmp_path / "runs" / "a", name)
    write_run(tmp_path / "runs" / "=1+1", "seen")
    written(tmp_path)
    for file in ("runs.csv", "groups.csv"):
        with (tmp_path / file).open(newline="") as opened:
            cells = [cell for row in csv.reader(opened) for cell in row]
        assert f"'{name}".replace("\r", " ") in cells
        assert "'=1+1" in cells or file == "groups.csv"
        for cell in cells:
            assert not cell.startswith(("=", "+", "-", "@", "\t", "\r")) or math.isfinite(float(cell))


def test_the_best_picture_is_named_with_those_that_may_be_as_good(tmp_path: Path) -> None:
    for window in range(12):
        hard = 0.02 * (window % 3)
        for controller, ssim in (("seen", 0.9), ("l2a", 0.89 + 0.03 * (window % 2)), ("latency", 0.7)):
            for rtt_ms in (20.0, 100.0):
                folder = tmp_path / "runs" / f"{controller}-{window}-{rtt_ms:g}"
                lower = 0.3 if rtt_ms == 100 and controller == "seen" else hard
                write_run(folder, controller, "bus", rtt_ms, offset_s=8.0 * window, view_ssim=ssim - lower)
    near, far = best_rows(Groups.from_runs(load_results(tmp_path).runs), "study")
    assert near[:4] == ["study", "20", "L2A", "0.885"]
    assert near[5].startswith("Seen (-0.005 [-0.0")
    assert "Latency" not in near[5], "worse in every window"
    assert far[5] == "none", "of Seen and Latency"


def test_with_few_windows_nobody_is_as_good_or_worse(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a", "seen", view_ssim=0.9)
    assert best_rows(Groups.from_runs(load_results(tmp_path).runs), "study") == []
    write_run(tmp_path / "runs" / "b", "l2a", view_ssim=0.8)
    assert best_rows(Groups.from_runs(load_results(tmp_path).runs), "study") == [
        ["study", "20", "Seen", "0.900", "8.0", "unknown: fewer than 12 network windows"]
    ]
