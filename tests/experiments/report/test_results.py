"""The figures in CSV files and tables, against runs whose figures are known."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import pytest

from tests.experiments.report.made_up_results import SCENE_BYTES, write_run
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.report.csv_files import write_csv
from tigas_experiments.report.experiment import cell, warnings, write_experiment_report
from tigas_experiments.report.metrics import HEIGHT, IN_TIME, PHOTON_P50, PHOTON_P95, RESPONSE_MEAN
from tigas_experiments.report.results import Spread, load


def test_a_row_of_runs_csv_has_every_field_and_figure(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "a"
    write_run(folder, "budget", "bus", 50.0, delay_ms=80, reply_ms=60, rungs=(1, 3), hold=50, kbps=4000, repeat=2)
    write_run(tmp_path / "runs" / "b", 2, "bus", None, every=2, delay_ms=120)
    write_csv(load(tmp_path), tmp_path)
    with (tmp_path / "runs.csv").open(newline="") as file:
        one, two = csv.DictReader(file)
    expected = {
        "folder": "a",
        "status": "complete",
        "network": "bus",
        "rtt_ms": "50.0",
        "controller": "budget",
        "configuration_scene": "courtyard",
        "configuration_movement": "stroll",
        "configuration_network_trace": "bus",
        "configuration_mode": "stateless",
        "configuration_profile": "budget",
        "configuration_repeat": "2",
        "configuration_duration_s": "2.0",
        "scene_bytes": str(SCENE_BYTES),
        "saturated": "False",
    }
    assert {name: one[name] for name in expected} == expected
    figures = {
        "motion_to_photon_p50_ms": 80,
        "motion_to_photon_p95_ms": 80,
        "inputs": 100,
        "inputs_unanswered": 0,
        "inputs_within_100ms_pct": 100,
        "response_mean_ms": 80,
        "response_p95_ms": 80,
        "reply_mean_ms": 60,
        "reply_p50_ms": 60,
        "reply_p95_ms": 60,
        "new_views_per_s": 97 / 2,  # the last three come after the movement's end
        "received_mbit_s": 4,
        "over_link_mbit_s": 4,
        "link_mbit_s": 20,
        "profile_changes_per_min": 1 * 30,  # one in two seconds
        "picture_ssim": 0.9,
        "view_psnr_db": 20,
    }
    assert {name: float(one[name]) for name in figures} == pytest.approx(figures)
    # Rung 1 from 80 ms to 1080 ms, then rung 3 until 2000 ms.
    share = 1000 / 1920
    assert float(one["profile_1_pct"]) == pytest.approx(100 * share)
    assert float(one["mean_profile"]) == pytest.approx(share * 1 + (1 - share) * 3)
    assert float(one["mean_height_px"]) == pytest.approx(share * 720 + (1 - share) * 240)
    assert (two["controller"], two["rtt_ms"], two["profile_1_pct"]) == ("profile-2", "", "")
    assert float(two["motion_to_photon_p50_ms"]) == 120, "every second input is answered by a frame of its own"
    assert float(two["motion_to_photon_p95_ms"]) == 140, "the others by the next one's"
    assert float(two["response_p95_ms"]) == 120, "a response is a frame's own"
    assert two["reply_p95_ms"] == "", "nobody recorded replies"


def test_a_group_has_mean_range_and_interval_over_its_runs(tmp_path: Path) -> None:
    for repeat, delay in enumerate((40.0, 50.0, 90.0)):
        write_run(tmp_path / "runs" / f"{repeat}", delay_ms=delay, repeat=repeat)
    write_run(tmp_path / "runs" / "other", delay_ms=70, rtt_ms=100)
    results = load(tmp_path)
    write_csv(results, tmp_path)
    with (tmp_path / "groups.csv").open(newline="") as file:
        one, other = csv.DictReader(file)
    assert [one[name] for name in ("network", "rtt_ms", "controller", "runs")] == ["bus", "20.0", "latency", "3"]
    figures = [float(one[f"response_mean_ms_{name}"]) for name in ("mean", "min", "max", "ci95")]
    # t(0.975, 2) = 4.3027; the sample's standard deviation of 40, 50, 90 is 26.458.
    assert figures == pytest.approx([60, 40, 90, 4.3027 * 26.458 / math.sqrt(3)], rel=1e-4)
    assert (other["rtt_ms"], other["response_mean_ms_ci95"]) == ("100.0", "")
    assert cell(results.groups[0].spread(RESPONSE_MEAN), RESPONSE_MEAN) == ("60", "40–90")
    assert cell(results.groups[1].spread(RESPONSE_MEAN), RESPONSE_MEAN) == ("70", None)


def test_a_time_that_never_came_is_no_time(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", delay_ms=40)
    frames = (path / "frames.ndjson").read_text().splitlines(keepends=True)
    (path / "frames.ndjson").write_text("".join(frames[:60]))
    write_run(tmp_path / "runs" / "b", delay_ms=40, repeat=1)
    (group,) = load(tmp_path).groups
    p95, in_time = group.spread(PHOTON_P95), group.spread(IN_TIME)
    assert p95 is not None
    assert (p95.low, p95.mean, p95.ci95) == (40, math.inf, None)
    assert cell(group.spread(PHOTON_P95), PHOTON_P95) == ("never", "40–never")
    assert in_time is not None
    assert in_time.mean == pytest.approx((60 + 100) / 2)
    assert write_experiment_report(tmp_path, tmp_path).page.exists()


def test_nobody_moved_and_nothing_came(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a")
    for name in ("inputs", "frames", "traffic", "link", "quality"):
        (path / f"{name}.ndjson").write_text("")
    (group,) = load(tmp_path).groups
    assert group.spread(PHOTON_P50) is None
    assert group.spread(HEIGHT) is None
    assert cell(group.spread(HEIGHT), HEIGHT) == ("–", None)
    write_experiment_report(tmp_path, tmp_path)


def test_a_spread_leaves_out_runs_that_lack_the_figure() -> None:
    assert Spread.over([None, 3.0, None]) == Spread(3.0, 3.0, 3.0, 1, None)
    assert Spread.over([None]) is None


def test_the_mean_of_equal_values_is_one_of_them() -> None:
    assert sum([0.1] * 6) / 6 < 0.1, "else there is nothing to test"
    spread = Spread.over([0.1] * 6)
    assert spread is not None
    assert spread.low == spread.mean == spread.high


def test_the_machine_is_named_where_it_was_the_bottleneck(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a", busy=1.0)
    write_run(tmp_path / "runs" / "b", repeat=1)
    report = write_experiment_report(tmp_path, tmp_path)
    assert any("The machine was the bottleneck in 1 of 2 runs" in warning for warning in report.warnings)
    assert "Latency*" in (tmp_path / "report.html").read_text()
    with (tmp_path / "groups.csv").open(newline="") as file:
        assert [row["runs_saturated"] for row in csv.DictReader(file)] == ["1"]


def test_runs_that_differ_in_what_a_row_does_not_say_are_named(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a")
    write_run(tmp_path / "runs" / "b", seconds=3.0, width=320)
    said = " ".join(warnings(load(tmp_path)))
    assert "Runs of different durations (2 s, 3 s) are taken together." in said
    assert "Runs of different viewports (320×360, 640×360) are taken together." in said


def test_inputs_that_were_changed_and_runs_that_are_missing_are_named(tmp_path: Path) -> None:
    record = ExperimentRecord(name="walk", created="2026-01-01T00:00:00Z", source="command", plan={}, planned=5)
    write_experiment(tmp_path, record)
    for repeat, movement in enumerate(("a" * 64, "a" * 64, "b" * 64)):
        path = write_run(tmp_path / "runs" / f"{repeat}", movement="walks/user3.csv", repeat=repeat) / "run.json"
        record_of_run = json.loads(path.read_text())
        path.write_text(json.dumps(record_of_run | {"inputs_sha256": {"movement": movement, "trace": "c" * 64}}))
    said = warnings(load(tmp_path))
    assert "The movement user3.csv was not the same in all runs." in said
    assert "2 of 5 planned runs have not been made." in said
    assert not any("trace" in warning for warning in said)


def test_an_experiment_is_called_by_its_name(tmp_path: Path) -> None:
    record = ExperimentRecord(name="Round <trips>", created="2026-01-01T00:00:00Z", source="page", plan={})
    write_experiment(tmp_path, record)
    write_run(tmp_path / "runs" / "a")
    write_experiment_report(tmp_path, tmp_path)
    assert "<h1>Round &lt;trips&gt;</h1>" in (tmp_path / "report.html").read_text()
    (tmp_path / "experiment.json").write_text("{")
    assert load(tmp_path).title == tmp_path.name
