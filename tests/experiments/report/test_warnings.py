"""Notices that a reader needs to judge the figures."""

from __future__ import annotations

import json
from pathlib import Path

from tests.experiments.report.synthetic_results import write_run
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.records.scores import SCORES, Score, write_scores
from tigas_experiments.report.results import load, sampled_runs
from tigas_experiments.report.warnings import FEW, warnings


def warned(folder: Path) -> list[str]:
    """The warnings about the runs of a folder."""
    results = load(folder)
    return warnings(results, sampled_runs(results))


def test_runs_that_differ_in_what_a_row_does_not_say_are_named(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a")
    write_run(tmp_path / "runs" / "b", seconds=3.0, width=320)
    said = " ".join(warned(tmp_path))
    assert "Runs of different durations (2 s, 3 s) are pooled." in said
    assert "Runs of different viewports (320×360, 640×360) are pooled." in said


def test_a_scene_of_another_content_is_named_even_if_it_is_as_large(tmp_path: Path) -> None:
    for repeat, digest in enumerate((None, "a" * 64, "a" * 64)):
        path = write_run(tmp_path / "runs" / f"{repeat}", repeat=repeat) / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"scene_sha256": digest}))
    assert not any("scene" in warning for warning in warned(tmp_path)), "early runs say nothing"
    path.write_text(path.read_text().replace("a" * 64, "b" * 64))
    assert "The scene courtyard was not the same in all runs." in warned(tmp_path)


def test_runs_without_all_of_their_samples_are_counted(tmp_path: Path) -> None:
    for repeat, problem in enumerate((None, "The browser’s storage is full. Nothing was sampled.")):
        path = write_run(tmp_path / "runs" / f"{repeat}", repeat=repeat) / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"sampling_problem": problem}))
    (said,) = (warning for warning in warned(tmp_path) if "sampled" in warning)
    assert said == "bus,20ms-rtt, Stateless, latency (2): The browser’s storage is full. Nothing was sampled."


def test_broken_scores_cost_a_run_its_scores_alone(tmp_path: Path) -> None:
    run = write_run(tmp_path / "runs" / "a")
    write_scores(run, [Score(seq=1, picture="original", digest="a", psnr=30.0)])
    (scores := run / SCORES).write_text(scores.read_text() + "half a li")
    results = load(tmp_path)
    assert results.failures == ()
    assert len(results.runs[0].latencies) > 0
    assert results.runs[0].scores == ()
    sentence = "a: picture scores are missing. runs/a/scores.ndjson, line 2: "
    assert sum(said.startswith(sentence) for said in warned(tmp_path)) == 1


def test_inputs_that_were_changed_and_runs_that_are_missing_are_named(tmp_path: Path) -> None:
    record = ExperimentRecord(name="walk", created="2026-01-01T00:00:00Z", source="command", plan={}, planned=5)
    write_experiment(tmp_path, record)
    for repeat, movement in enumerate(("a" * 64, "a" * 64, "b" * 64)):
        path = write_run(tmp_path / "runs" / f"{repeat}", movement="walks/user3.csv", repeat=repeat) / "run.json"
        record_of_run = json.loads(path.read_text())
        path.write_text(json.dumps(record_of_run | {"inputs_sha256": {"movement": movement, "trace": "c" * 64}}))
    said = warned(tmp_path)
    assert "The movement user3.csv was not the same in all runs." in said
    assert "2 of 5 planned runs are missing." in said
    assert not any("trace" in warning for warning in said)


def with_load(run: Path, **load: object) -> Path:
    """The same run under another load of the machine."""
    path = run / "run.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps(record | {"load": record["load"] | load}))
    return run


def test_threads_at_their_limit_and_what_nobody_watched_are_told(tmp_path: Path) -> None:
    made = [write_run(tmp_path / "runs" / f"{repeat}", repeat=repeat) for repeat in range(4)]
    with_load(made[0], pegged={"chromium renderer": 0.34, "tigas render": 0.1}, services="threads")
    with_load(made[1], pegged={"chromium renderer": 0.2}, services="elsewhere")
    with_load(made[2], pegged={}, services="processors")
    run = "bus,20ms-rtt, Stateless, latency"
    assert warned(tmp_path) == [
        f"2 of 4 runs ({run}; {run} (2)): the busiest thread of chromium renderer was at its limit in 20% to 34% of "
        "the samples.",
        f"{run} (2): services ran on another machine, without monitoring of its load.",
        f"{run} (3): the services' threads were not monitored.",
        f"{run} (4): threads were not monitored.",
    ]


def test_of_early_runs_nothing_is_said_that_nobody_watched(tmp_path: Path) -> None:
    run = write_run(tmp_path / "runs" / "a", busy=1.0) / "run.json"
    record = json.loads(run.read_text())
    early = ("cpu_mean", "cpu_max", "saturated_share", "load_average_max")
    run.write_text(json.dumps(record | {"load": {name: record["load"][name] for name in early} | {"processors": 64}}))
    saturated, unwatched = warned(tmp_path)
    assert "processors were saturated during 100% of the run (100% busy on average)" in saturated
    assert unwatched == "bus,20ms-rtt, Stateless, latency: threads were not monitored."


def test_warnings_of_one_kind_are_one_with_the_runs_that_it_is_of(tmp_path: Path) -> None:
    for number, busy in enumerate((1.0, 1.0, 0.5)):
        write_run(tmp_path / "runs" / f"{number}", "budget", mode="stateless", busy=busy, repeat=number)
    run = tmp_path / "runs" / "1" / "run.json"
    record = json.loads(run.read_text())
    run.write_text(json.dumps(record | {"load": record["load"] | {"saturated_share": 0.3, "cpu_mean": 0.8}}))
    assert warned(tmp_path)[0] == (
        "2 of 3 runs (bus,20ms-rtt, Stateless, budget; bus,20ms-rtt, Stateless, budget (2)): the machine's processors "
        "were saturated during 30% to 100% of the run (80% to 100% busy on average), which affects latencies and "
        "frame rates; marked with *."
    )
    for path in (tmp_path / "runs").glob("*/run.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"load": None}))
    assert warned(tmp_path) == ["Each of the 3 runs: the machine's load is unknown."]


def test_many_runs_are_counted_and_not_named(tmp_path: Path) -> None:
    for number in range(FEW + 2):
        write_run(tmp_path / "runs" / f"{number}", busy=1.0 if number else 0.5, repeat=number)
    assert warned(tmp_path)[0].startswith(f"{FEW + 1} of {FEW + 2} runs: the machine's processors were saturated")


def test_runs_that_failed_for_one_reason_are_one_warning(tmp_path: Path) -> None:
    for number in range(FEW + 2):
        path = write_run(tmp_path / "runs" / f"{number}", repeat=number) / "run.json"
        failed = json.loads(path.read_text()) | {"status": "failed", "problem": "The shaper fell silent."}
        path.write_text(json.dumps(failed))
    (said,) = warned(tmp_path)
    assert said.startswith(f"Each of the {FEW + 2} runs: no result. ")
    assert said.endswith("The shaper fell silent.")
