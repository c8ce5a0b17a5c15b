"""The page of a report on runs with known figures."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import pytest

from tests.experiments.report.synthetic_results import write_large, write_run
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.report import figures
from tigas_experiments.report.groups import Spread
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.report.page import cell
from tigas_experiments.report.report import write_report
from tigas_experiments.report.results import load


def test_a_cell_has_the_mean_and_the_range_where_there_is_one() -> None:
    assert cell(Spread.over([40.0, 50.0, 90.0]), METRICS["frame_age_mean_ms"]) == ("60", "40–90")
    assert cell(Spread.over([70.0]), METRICS["frame_age_mean_ms"]) == ("70", None)
    assert cell(Spread.over([40.0, math.inf]), METRICS["motion_to_photon_p95_ms"]) == ("never", "40–never")
    assert cell(None, METRICS["mean_height_px"]) == ("–", None)


def test_what_never_came_is_a_report_too(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", delay_ms=40)
    frames = (path / "frames.ndjson").read_text().splitlines(keepends=True)
    (path / "frames.ndjson").write_text("".join(frames[:60]))
    write_run(tmp_path / "runs" / "b", delay_ms=40, repeat=1)
    assert "<td>never<br>" in write_report(tmp_path, tmp_path).page.read_text()


def test_so_is_nothing_at_all(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a")
    for name in ("inputs", "frames", "traffic", "link", "quality"):
        (path / f"{name}.ndjson").write_text("")
    assert "<td>–</td>" in write_report(tmp_path, tmp_path).page.read_text()


def test_the_machine_is_named_where_it_was_the_bottleneck(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a", busy=1.0)
    write_run(tmp_path / "runs" / "b", repeat=1)
    report = write_report(tmp_path, tmp_path)
    (warning,) = (warning for warning in report.warnings if "saturated" in warning)
    assert warning.startswith("bus,20ms-rtt, Stateless, latency: the machine's processors were saturated during 100%")
    assert warning.endswith("marked with *.")
    assert "Latency*" in (tmp_path / "report.html").read_text()
    with (tmp_path / "groups.csv").open(newline="") as file:
        assert [row["runs_saturated"] for row in csv.DictReader(file)] == ["1"]


def test_a_thread_at_its_limit_is_in_the_table_of_runs(tmp_path: Path) -> None:
    for repeat, pegged in enumerate((None, {}, {"chromium renderer": 0.34, "tigas render": 0.2})):
        path = write_run(tmp_path / "runs" / f"{repeat}", repeat=repeat) / "run.json"
        record = json.loads(path.read_text())
        path.write_text(json.dumps(record | {"load": record["load"] | {"pegged": pegged}}))
    page = write_report(tmp_path, tmp_path).page.read_text()
    for expected in ("<td>unknown</td>", "<td>never</td>", "<td>34 % (chromium renderer)</td>"):
        assert page.count(expected) == 1, expected
    with (tmp_path / "runs.csv").open(newline="") as file:
        rows = [(row["pegged_thread_of"], row["pegged_thread_pct"]) for row in csv.DictReader(file)]
    assert rows == [("", ""), ("", ""), ("chromium renderer", "34.0")]


def test_an_experiment_is_called_by_its_name(tmp_path: Path) -> None:
    record = ExperimentRecord(name="Round <trips>", created="2026-01-01T00:00:00Z", source="page", plan={})
    write_experiment(tmp_path, record)
    write_run(tmp_path / "runs" / "a")
    write_report(tmp_path, tmp_path)
    assert "<h1>Round &lt;trips&gt;</h1>" in (tmp_path / "report.html").read_text()
    (tmp_path / "experiment.json").write_text("{")
    assert load(tmp_path).title == tmp_path.name


def test_the_page_has_it_where_there_are_several_networks(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "one", "l2a|\n", "bus", delay_ms=40)
    write_report(tmp_path, tmp_path)
    assert "All networks" not in (tmp_path / "report.html").read_text()
    assert "| 20 | l2a\\| | 1 | 40 |" in (tmp_path / "overall.md").read_text()
    write_run(tmp_path / "runs" / "other", "l2a|\n", "tram", delay_ms=80)
    write_report(tmp_path, tmp_path)
    assert "Means over the 2 networks" in (tmp_path / "report.html").read_text()


def test_a_large_experiment_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "MOST_NETWORKS", 1)
    count = write_large(tmp_path, ("first", "second"), (20, 50), 1, seconds=20.0)
    assert count == 24
    heard: list[tuple[str, int, int | None]] = []
    report = write_report(tmp_path, tmp_path, on_progress=lambda *step: heard.append(step))
    assert heard == [
        *(("reads runs", done, 24) for done in range(1, 25)),
        *(("draws figures", done, None) for done in range(1, 2 + 8 + 1)),
    ], "one network is drawn by itself"
    assert "Only the first 1 of 2 networks" in report.page.read_text()
    assert report.page.stat().st_size < 1_100_000, "however long the runs are"
    assert len(report.groups) == 24
