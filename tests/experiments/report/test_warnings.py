"""Notices that a reader needs to judge the figures."""

from __future__ import annotations

from pathlib import Path

from tests.experiments.report.synthetic_results import change, write_run
from tigas_experiments.records.folder import ExperimentRecord, RunWriter, StoredRun, write_experiment
from tigas_experiments.records.scores import SCORES, Score, write_scores
from tigas_experiments.report.run_table import load_results
from tigas_experiments.report.warnings import MAX_LISTED, collect_warnings
from tigas_experiments.wire.recording import ShownFrame

RUN = "bus,20ms-rtt, Stateless, latency"


def warned(folder: Path) -> list[str]:
    """The warnings about the runs of a folder."""
    return collect_warnings(load_results(folder))


def repeats(folder: Path, count: int) -> list[Path]:
    return [write_run(folder / "runs" / f"{repeat}", repeat=repeat) for repeat in range(count)]


def test_runs_that_differ_in_what_a_row_does_not_say_are_named(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a")
    write_run(tmp_path / "runs" / "b", seconds=3.0, width=320)
    said = warned(tmp_path)
    assert "Runs of different durations (2 s, 3 s) are pooled." in said
    assert "Runs of different viewports (320×360, 640×360) are pooled." in said


def test_a_scene_of_another_content_is_named_even_if_it_is_as_large(tmp_path: Path) -> None:
    runs = repeats(tmp_path, 3)
    for run in runs[1:]:
        change(run, scene_sha256="a" * 64)
    assert not any("scene" in warning for warning in warned(tmp_path)), "early runs say nothing"
    change(runs[2], scene_sha256="b" * 64)
    assert "The scene courtyard was not the same in all runs." in warned(tmp_path)


def test_runs_without_all_of_their_samples_are_counted(tmp_path: Path) -> None:
    _, run = repeats(tmp_path, 2)
    change(run, sampling_problem="The browser’s storage is full. Nothing was sampled.")
    assert f"{RUN} (2): The browser’s storage is full. Nothing was sampled." in warned(tmp_path)


def test_runs_without_frames_are_named_as_means_over_frames_lack_them(tmp_path: Path) -> None:
    _, run = repeats(tmp_path, 2)
    RunWriter.resume(StoredRun(run)).write(ShownFrame, [])
    assert (
        f"{RUN} (2): no frame was shown, so means over frames, such as of their age, are of the other runs."
        in warned(tmp_path)
    )


def test_broken_scores_cost_a_run_its_scores_alone(tmp_path: Path) -> None:
    run = write_run(tmp_path / "runs" / "a")
    write_scores(run, [Score(seq=1, picture="original", digest="a", psnr=30.0)])
    (scores := run / SCORES).write_text(scores.read_text() + "half a li")
    (found,) = load_results(tmp_path).runs
    assert len(found.series["latency"]) > 0
    assert found.scores == []
    sentence = "a: picture scores are missing. runs/a/scores.ndjson, line 2: "
    assert sum(said.startswith(sentence) for said in warned(tmp_path)) == 1


def test_inputs_that_were_changed_and_runs_that_are_missing_are_named(tmp_path: Path) -> None:
    record = ExperimentRecord(name="walk", created="2026-01-01T00:00:00Z", source="command", plan={}, planned=5)
    write_experiment(tmp_path, record)
    for run, digest in zip(repeats(tmp_path, 3), ("a" * 64, "a" * 64, "b" * 64), strict=True):
        change(run, inputs_sha256={"movement": digest, "trace": "c" * 64})
    said = warned(tmp_path)
    assert "The movement stroll was not the same in all runs." in said
    assert "2 of 5 planned runs are missing." in said
    assert not any("trace" in warning for warning in said)


def test_threads_at_their_limit_and_what_nobody_watched_are_told(tmp_path: Path) -> None:
    first, second, third, _ = repeats(tmp_path, 4)
    change(first, load={"pegged": {"chromium renderer": 0.34, "tigas render": 0.1}, "services": "threads"})
    change(second, load={"pegged": {"chromium renderer": 0.2}, "services": "elsewhere"})
    change(third, load={"pegged": {}, "services": "processors"})
    assert warned(tmp_path) == [
        f"2 of 4 runs ({RUN}; {RUN} (2)): the busiest thread of chromium renderer was at its limit in 20% to 34% of "
        "the samples.",
        f"{RUN} (2): services ran on another machine, without monitoring of its load.",
        f"{RUN} (3): the services' threads were not monitored.",
        f"{RUN} (4): threads were not monitored.",
    ]


def test_warnings_of_one_kind_are_one_with_the_runs_that_it_is_of(tmp_path: Path) -> None:
    first, second, _ = repeats(tmp_path, 3)
    change(first, load={"saturated_share": 1.0, "cpu_mean": 1.0})
    change(second, load={"saturated_share": 0.3, "cpu_mean": 0.8})
    assert warned(tmp_path) == [
        f"2 of 3 runs ({RUN}; {RUN} (2)): processors or the render service were saturated during 30% to 100% of the "
        "run (processors 80% to 100% busy on average), which affects latencies and frame rates; marked with *.",
        "Each of the 3 runs: threads were not monitored.",
    ]
    change(first, load={"saturated_share": 0.0, "render_busy_share": 0.5})
    assert f"{RUN}: the render service was at its limit in 50% of the samples." in warned(tmp_path)[1]
    for run in (tmp_path / "runs").iterdir():
        change(run, load=None)
    assert warned(tmp_path) == ["Each of the 3 runs: the machine's load is unknown."]


def test_many_runs_are_counted_and_not_named(tmp_path: Path) -> None:
    for run in repeats(tmp_path, MAX_LISTED + 2)[1:]:
        change(run, load={"saturated_share": 1.0})
    assert warned(tmp_path)[0].startswith(
        f"{MAX_LISTED + 1} of {MAX_LISTED + 2} runs: processors or the render service were saturated"
    )


def test_runs_that_failed_for_one_reason_are_one_warning(tmp_path: Path) -> None:
    for run in repeats(tmp_path, MAX_LISTED + 2):
        change(run, status="failed", problem="The shaper fell silent.")
    assert warned(tmp_path) == [f"Each of the {MAX_LISTED + 2} runs: no result. The shaper fell silent."]
