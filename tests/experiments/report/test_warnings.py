"""What a reader must know before believing the figures."""

from __future__ import annotations

import json
from pathlib import Path

from tests.experiments.report.made_up_results import write_run
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.records.scores import SCORES, Score, write_scores
from tigas_experiments.report.results import load
from tigas_experiments.report.warnings import comparison_warnings, experiment_warnings


def test_runs_that_differ_in_what_a_row_does_not_say_are_named(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a")
    write_run(tmp_path / "runs" / "b", seconds=3.0, width=320)
    said = " ".join(experiment_warnings(load(tmp_path)))
    assert "Runs of different durations (2 s, 3 s) are taken together." in said
    assert "Runs of different viewports (320×360, 640×360) are taken together." in said


def test_a_scene_of_another_content_is_named_even_if_it_is_as_large(tmp_path: Path) -> None:
    for repeat, digest in enumerate((None, "a" * 64, "a" * 64)):
        path = write_run(tmp_path / "runs" / f"{repeat}", repeat=repeat) / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"scene_sha256": digest}))
    assert not any("scene" in warning for warning in experiment_warnings(load(tmp_path))), "early runs say nothing"
    path.write_text(path.read_text().replace("a" * 64, "b" * 64))
    assert "The scene courtyard was not the same in all runs." in experiment_warnings(load(tmp_path))


def test_runs_without_all_of_their_samples_are_counted(tmp_path: Path) -> None:
    for repeat, problem in enumerate((None, "The browser’s storage is full. Nothing was sampled.")):
        path = write_run(tmp_path / "runs" / f"{repeat}", repeat=repeat) / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"sampling_problem": problem}))
    results = load(tmp_path)
    assert "1 of 2 runs have fewer samples than were asked for; their run.json says why." in experiment_warnings(
        results
    )
    assert sum("The browser’s storage is full." in warning for warning in comparison_warnings(results)) == 1


def test_broken_scores_cost_a_run_its_scores_alone(tmp_path: Path) -> None:
    run = write_run(tmp_path / "runs" / "a")
    write_scores(run, [Score(seq=1, picture="original", digest="a", psnr=30.0)])
    (scores := run / SCORES).write_text(scores.read_text() + "half a li")
    results = load(tmp_path)
    assert results.failures == ()
    assert len(results.runs[0].latencies) > 0
    assert results.runs[0].scores == ()
    sentence = "a: its pictures' scores are missing. runs/a/scores.ndjson, line 2: "
    for warnings in (experiment_warnings, comparison_warnings):
        assert sum(said.startswith(sentence) for said in warnings(results)) == 1


def test_inputs_that_were_changed_and_runs_that_are_missing_are_named(tmp_path: Path) -> None:
    record = ExperimentRecord(name="walk", created="2026-01-01T00:00:00Z", source="command", plan={}, planned=5)
    write_experiment(tmp_path, record)
    for repeat, movement in enumerate(("a" * 64, "a" * 64, "b" * 64)):
        path = write_run(tmp_path / "runs" / f"{repeat}", movement="walks/user3.csv", repeat=repeat) / "run.json"
        record_of_run = json.loads(path.read_text())
        path.write_text(json.dumps(record_of_run | {"inputs_sha256": {"movement": movement, "trace": "c" * 64}}))
    said = experiment_warnings(load(tmp_path))
    assert "The movement user3.csv was not the same in all runs." in said
    assert "2 of 5 planned runs have not been made." in said
    assert not any("trace" in warning for warning in said)
