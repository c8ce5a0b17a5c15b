"""Warnings that limit confidence in a report's results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from tigas_experiments.records.load import MAX_PEGGED_SHARE
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.groups import Comparison, comparisons
from tigas_experiments.report.run_listing import run_label
from tigas_experiments.report.run_table import Results, Run

MAX_LISTED = 4
"""Maximum number of runs named in a sentence, and of reasons listed."""


def collect_warnings(results: Results) -> list[str]:
    """All warnings: first on single runs, then on pooled runs."""
    runs = results.runs
    scores = [f"{run.name}: picture scores are missing. {run.scores_problem}" for run in runs if run.scores_problem]
    found = [*_failures(results), *_runs(runs), *scores, *_unmatched(runs)]
    found += [
        f"Runs of different {name} ({', '.join(values)}) are pooled."
        for name, values in _pooled(runs).items()
        if len(values) > 1
    ]
    found += [f"The {kind} {name} was not the same in all runs." for kind, name in _changed(runs)]
    planned = None if results.experiment is None else results.experiment.planned
    made = len(runs) + len(results.failures)
    if planned is not None and planned > made:
        found.append(f"{planned - made} of {planned} planned runs are missing.")
    commits = {run.record.machine.commit for run in runs}
    if len(commits) > 1:
        found.append(f"The runs were made with {len(commits)} different versions of TIGAS.")
    return [*found, *_samples(runs)]


def _failures(results: Results) -> list[str]:
    by_reason: dict[str, list[str]] = {}
    for name, reason in results.failures.items():
        by_reason.setdefault(reason, []).append(name)
    total = len(results.runs) + len(results.failures)
    if len(by_reason) > MAX_LISTED:
        return [f"{len(results.failures)} of {total} runs failed and are in no figure; the page lists the reasons."]
    return [f"{_affected_runs(names, total)}: no result. {reason}" for reason, names in by_reason.items()]


def _runs(runs: Sequence[Run]) -> list[str]:
    """One sentence per kind of problem, with the affected runs."""
    found = _busy(runs)
    for run in runs:
        load, recording, problem = run.record.load, run.record.recording, run.record.sampling_problem
        kinds = {
            "the machine's load is unknown.": load is None,
            f"{problem}": problem is not None,
            "the page was hidden at times, so the browser may have delayed frames.": recording and recording.hidden,
            "services ran on another machine, without monitoring of its load.": load and load.services == "elsewhere",
            "the services' threads were not monitored.": load and load.services == "processors",
            "threads were not monitored.": load and load.pegged is None,
            "no frame was shown, so means over frames, such as of their age, are of the other runs.": run.values[
                "frame_age_mean_ms"
            ]
            is None,
        }
        for sentence, applies in kinds.items():
            if applies:
                found.setdefault(sentence, []).append(run)
    names = {run: f"{run.configuration.network.label}, {run_label(run)}" for run in runs}
    return [f"{_affected_runs([names[run] for run in own], len(runs))}: {sentence}" for sentence, own in found.items()]


def _busy(runs: Sequence[Run]) -> dict[str, list[Run]]:
    found: dict[str, list[Run]] = {}
    loads = {run: run.record.load for run in runs if run.record.load is not None}
    if saturated := {run: load for run, load in loads.items() if load.saturated}:
        shares = _range(load.saturated_share for load in saturated.values())
        busy = _range(load.cpu_mean for load in saturated.values())
        sentence = f"processors or the render service were saturated during {shares} of the run (processors {busy} busy"
        found[f"{sentence} on average), which affects latencies and frame rates; marked with *."] = [*saturated]
    busy_renders = {run: load.render_busy_share or 0.0 for run, load in loads.items()}
    if at_limit := {run: share for run, share in busy_renders.items() if share > MAX_PEGGED_SHARE}:
        found[f"the render service was at its limit in {_range(at_limit.values())} of the samples."] = [*at_limit]
    for process in dict.fromkeys(process for load in loads.values() for process in load.often_pegged):
        pegged = {run: load.often_pegged[process] for run, load in loads.items() if process in load.often_pegged}
        sentence = f"the busiest thread of {process} was at its limit in {_range(pegged.values())} of the samples."
        found[sentence] = [*pegged]
    return found


def _affected_runs(names: Sequence[str], total: int) -> str:
    """The affected runs as the subject of a sentence."""
    if len(names) == total > 1:
        return f"Each of the {total} runs"
    if len(names) == 1:
        return names[0]
    return f"{len(names)} of {total} runs" + (f" ({'; '.join(names)})" if len(names) <= MAX_LISTED else "")


def _range(shares: Iterable[float]) -> str:
    found = sorted(shares)
    return " to ".join(dict.fromkeys(f"{share:.0%}" for share in (found[0], found[-1])))


def _samples(runs: Sequence[Run]) -> list[str]:
    found = [
        f"{run.name}: rendering again gave different frames for {run.sampled.different} of {len(run.sampled.samples)} "
        "samples, so ground truth may come from another renderer than the frames."
        for run in runs
        if run.sampled.different
    ]
    total, missing = sum(len(run.sampled.samples) for run in runs), sum(run.sampled.missing for run in runs)
    again = f"{missing} of {total} samples have not been rendered again yet: run `tigas experiment rerender DIR`."
    return [*found, again] if missing else found


def _unmatched(runs: Sequence[Run]) -> list[str]:
    found = []
    compared = [each for each in comparisons(runs) if each.missing]
    if partly := [each for each in compared if each.common]:
        left_out = sum(len(own) - len(each.kept[condition]) for each in partly for condition, own in each.runs.items())
        found.append(
            f"Tables and figures leave out {left_out} of {len(runs)} runs, because not all controllers have "
            f"runs of their blocks: {_format_missing(partly)}."
        )
    if apart := [each for each in compared if not each.common]:
        networks = dict.fromkeys(next(iter(each.runs.values()))[0].configuration.network.label for each in apart)
        found.append(
            f"Over {', '.join(networks)}, no block has runs of all controllers: their means cover different inputs and "
            f"cannot be compared ({_format_missing(apart)})."
        )
    return found


def _format_missing(compared: Sequence[Comparison]) -> str:
    missing = sum((each.missing for each in compared), Counter[Controller]())
    return ", ".join(f"{controller.title} lacks {count}" for controller, count in missing.most_common())


def _changed(runs: Sequence[Run]) -> list[tuple[str, str]]:
    """Kind and name of inputs with different contents in different runs."""
    contents: dict[tuple[str, str, type], set[object]] = {}
    for run in runs:
        digests = run.record.inputs_sha256
        for kind, name, content in (
            ("scene", run.block.scene, run.record.scene_bytes),
            ("scene", run.block.scene, run.record.scene_sha256),
            ("movement", run.block.movement, digests and digests.movement),
            ("trace", run.block.network, digests and digests.trace),
        ):
            if content is not None:
                contents.setdefault((kind, name, type(content)), set()).add(content)
    return list(dict.fromkeys((kind, name) for (kind, name, _), found in contents.items() if len(found) > 1))


def _pooled(runs: Sequence[Run]) -> dict[str, list[str]]:
    every = [run.configuration for run in runs]
    positions = {f"{each.network.offset_s:g} s" for each in every if each.network.trace is not None}
    return {
        "durations": sorted({f"{each.duration_s:g} s" for each in every}),
        "viewports": sorted({f"{each.width}×{each.height}" for each in every}),
        "trace positions": [] if any(each.segment for each in every) else sorted(positions),  # segments are blocks
    }
