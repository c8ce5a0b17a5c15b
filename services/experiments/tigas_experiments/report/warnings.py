"""What a reader must know before believing the figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tigas_experiments.records.materialised import SampledRun
from tigas_experiments.report.comparison_table import label, runs_as_made
from tigas_experiments.report.results import Results


def unreadable(results: Results) -> list[str]:
    """What became of runs that cannot even be told of: a sentence each."""
    return [
        f"{failure.folder}: there is no result. {failure.reason}"
        for failure in results.failures
        if failure.record is None
    ]


def score_warnings(results: Results) -> list[str]:
    """Of the runs whose pictures' scores cannot be read: a sentence each."""
    return [
        f"{run.folder}: its pictures' scores are missing. {run.scores_problem}"
        for run in results.runs
        if run.scores_problem is not None
    ]


def sample_warnings(runs: Mapping[str, SampledRun]) -> list[str]:
    """Of the runs that have samples: where ground truth is doubtful, or is not there."""
    found = [
        f"{name}: asked again, the renderer answered differently for {run.different} of {len(run.samples)} samples, so "
        "that ground truth may be of another renderer than the frames."
        for name, run in runs.items()
        if run.different
    ]
    if missing := sum(run.missing for run in runs.values()):
        total = sum(len(run.samples) for run in runs.values())
        found.append(
            f"{missing} of {total} samples are not rendered again yet: `tigas experiment materialise DIR` does it."
        )
    return found


def comparison_warnings(results: Results) -> list[str]:
    """Run by run."""
    found = unreadable(results) + score_warnings(results)
    for run in runs_as_made(results):
        record = run.record
        name = f"{record.configuration.network.label}, {label(record)}"
        if run.problem is not None:
            found.append(f"{name}: there is no result. {run.problem}")
        elif record.load is None:
            found.append(f"{name}: the machine's load is unknown.")
        elif record.load.saturated:
            found.append(
                f"{name}: the machine's processors were saturated during {record.load.saturated_share:.0%} of the run "
                f"({record.load.cpu_mean:.0%} busy on average), so its latencies tell of the machine, too."
            )
        if record.sampling_problem is not None:
            found.append(f"{name}: {record.sampling_problem}")
        if record.recording is not None and record.recording.hidden:
            found.append(f"{name}: the page was hidden at some time, so that the browser may have held frames back.")
    return found


def experiment_warnings(results: Results) -> list[str]:
    """Of all runs together."""
    found: list[str] = []
    runs = results.runs
    total = len(runs) + len(results.failures)
    if results.failures:
        found.append(
            f"{len(results.failures)} of {total} runs have no result and are in no figure; they are listed below."
        )
    if saturated := [run for run in runs if run.saturated]:
        found.append(
            f"The machine was the bottleneck in {len(saturated)} of {len(runs)} runs: all processors were busy for "
            "more than a tenth of the time, so that their latencies and frame rates tell of the machine, too. They are "
            "marked with *."
        )
    if unknown := sum(run.record.load is None for run in runs):
        found.append(f"The load of the machine is unknown in {unknown} of {len(runs)} runs.")
    if hidden := sum(run.record.recording is not None and run.record.recording.hidden for run in runs):
        found.append(
            f"The page was hidden during {hidden} of {len(runs)} runs, so the browser may have held frames back."
        )
    if fewer := sum(run.record.sampling_problem is not None for run in runs):
        found.append(f"{fewer} of {len(runs)} runs have fewer samples than were asked for; their run.json says why.")
    found += score_warnings(results)
    for name, values in _pooled(results).items():
        if len(values) > 1:
            found.append(f"Runs of different {name} ({', '.join(values)}) are taken together.")
    found += [f"The {kind} {name} was not the same in all runs." for kind, name in _changed(results)]
    planned = None if results.experiment is None else results.experiment.planned
    if planned is not None and (missing := planned - total) > 0:
        found.append(f"{missing} of {planned} planned runs have not been made.")
    commits = {run.record.machine.commit for run in runs}
    if len(commits) > 1:
        found.append(f"The runs were made with {len(commits)} different versions of TIGAS.")
    return found


def _changed(results: Results) -> list[tuple[str, str]]:
    """Kind and name of the inputs whose content differs between runs."""
    contents: dict[tuple[str, str, type], set[str | int]] = {}
    for run in results.runs:
        record, configuration = run.record, run.record.configuration
        digests = record.inputs_sha256
        for kind, name, content in (
            ("scene", configuration.scene, record.scene_bytes),
            ("scene", configuration.scene, record.scene_sha256),
            ("movement", Path(configuration.movement).name, None if digests is None else digests.movement),
            ("trace", configuration.network.name, None if digests is None else digests.trace),
        ):
            if content is not None:
                contents.setdefault((kind, name, type(content)), set()).add(content)
    return list(dict.fromkeys((kind, name) for (kind, name, _), found in contents.items() if len(found) > 1))


def _pooled(results: Results) -> dict[str, list[str]]:
    """What no row, line or point tells apart, and the values that the runs have."""
    configurations = [run.record.configuration for run in results.runs]
    return {
        "durations": sorted({f"{each.duration_s:g} s" for each in configurations}),
        "viewports": sorted({f"{each.width}×{each.height}" for each in configurations}),
        "places in the trace": sorted(
            {f"{each.network.offset_s:g} s" for each in configurations if each.network.trace is not None}
            if not any(each.segment for each in configurations)  # which are blocks
            else ()
        ),
    }
