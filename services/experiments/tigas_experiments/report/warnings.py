"""Warnings that limit how far a report's figures can be trusted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from tigas_experiments.records.load import Load
from tigas_experiments.records.rerendered import SampledRun
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.groups import Comparison, comparisons
from tigas_experiments.report.results import Results, Run
from tigas_experiments.report.run_listing import label

FEW = 4
"""Maximum number of runs named in a sentence, and of reasons listed."""


def warnings(results: Results, sampled: Mapping[str, SampledRun]) -> list[str]:
    """All warnings: first on single runs, then on pooled runs."""
    found = [*_failures(results), *_runs(results.runs), *_scores(results.runs), *_uncommon(results)]
    for name, values in _pooled(results).items():
        if len(values) > 1:
            found.append(f"Runs of different {name} ({', '.join(values)}) are pooled.")
    found += [f"The {kind} {name} was not the same in all runs." for kind, name in _changed(results)]
    planned = None if results.experiment is None else results.experiment.planned
    if planned is not None and (missing := planned - len(results.runs) - len(results.failures)) > 0:
        found.append(f"{missing} of {planned} planned runs are missing.")
    commits = {run.record.machine.commit for run in results.runs}
    if len(commits) > 1:
        found.append(f"The runs were made with {len(commits)} different versions of TIGAS.")
    return [*found, *_sample_warnings(sampled)]


def _failures(results: Results) -> list[str]:
    """Warnings on failed runs."""
    total = len(results.runs) + len(results.failures)
    by_reason: dict[str, list[str]] = {}
    for failure in results.failures:
        by_reason.setdefault(failure.reason, []).append(failure.folder)
    if len(by_reason) > FEW:
        return [f"{len(results.failures)} of {total} runs failed and are in no figure; the page lists the reasons."]
    return [f"{_named(names, total)}: no result. {reason}" for reason, names in by_reason.items()]


def _scores(runs: Sequence[Run]) -> list[str]:
    """Warnings on unreadable picture scores."""
    return [
        f"{run.folder}: picture scores are missing. {run.scores_problem}"
        for run in runs
        if run.scores_problem is not None
    ]


def _runs(runs: Sequence[Run]) -> list[str]:
    """One sentence per kind of problem, with the affected runs."""
    found: dict[str, list[Run]] = {}
    for run in runs:
        record, load = run.record, run.record.load
        kinds = {
            "the machine's load is unknown.": load is None,
            f"{record.sampling_problem}": record.sampling_problem is not None,
            "the page was hidden at times, so the browser may have delayed frames.": (
                record.recording is not None and record.recording.hidden
            ),
        }
        if load is not None:
            kinds |= {
                "services ran on another machine, without monitoring of its load.": load.services == "elsewhere",
                "the services' threads were not monitored.": load.services == "processors",
                "threads were not monitored.": load.pegged is None,
            }
        for sentence, applies in kinds.items():
            if applies:
                found.setdefault(sentence, []).append(run)
    busy = _busy([(run, run.record.load) for run in runs if run.record.load is not None])
    return [
        f"{_named([_name(run) for run in those], len(runs))}: {sentence}" for sentence, those in (busy | found).items()
    ]


def _busy(loads: Sequence[tuple[Run, Load]]) -> dict[str, list[Run]]:
    """Sentences on overloaded machines, with the affected runs."""
    found: dict[str, list[Run]] = {}
    if saturated := [(run, load) for run, load in loads if load.saturated]:
        sentence = (
            f"the machine's processors were saturated during {_shares(load.saturated_share for _, load in saturated)} "
            f"of the run ({_shares(load.cpu_mean for _, load in saturated)} busy on average), which affects latencies "
            "and frame rates; marked with *."
        )
        found[sentence] = [run for run, _ in saturated]
    for process in dict.fromkeys(process for _, load in loads for process in load.often_pegged):
        pegged = [(run, share) for run, load in loads if (share := load.often_pegged.get(process)) is not None]
        shares = _shares(share for _, share in pegged)
        found[f"the busiest thread of {process} was at its limit in {shares} of the samples."] = [
            run for run, _ in pegged
        ]
    return found


def _name(run: Run) -> str:
    return f"{run.record.configuration.network.label}, {label(run.record)}"


def _named(names: Sequence[str], total: int) -> str:
    """The affected runs as the subject of a sentence."""
    if len(names) == total > 1:
        return f"Each of the {total} runs"
    if len(names) == 1:
        return names[0]
    return f"{len(names)} of {total} runs" + (f" ({'; '.join(names)})" if len(names) <= FEW else "")


def _shares(values: Iterable[float]) -> str:
    """Range of percentages."""
    found = sorted(values)
    return " to ".join(dict.fromkeys(f"{value:.0%}" for value in (found[0], found[-1])))


def _sample_warnings(runs: Mapping[str, SampledRun]) -> list[str]:
    """Warnings on doubtful or missing ground truth of samples."""
    found = [
        f"{name}: rendering again gave different frames for {run.different} of {len(run.samples)} samples, so ground "
        "truth may come from another renderer than the frames."
        for name, run in runs.items()
        if run.different
    ]
    if missing := sum(run.missing for run in runs.values()):
        total = sum(len(run.samples) for run in runs.values())
        found.append(
            f"{missing} of {total} samples have not been rendered again yet: run `tigas experiment rerender DIR`."
        )
    return found


def _uncommon(results: Results) -> list[str]:
    """Warnings on runs without a counterpart."""
    found = []
    compared = [each for each in comparisons(results.runs) if each.missing]
    if partly := [each for each in compared if each.common]:
        left_out = sum(len(runs) for each in partly for runs in each.runs.values()) - sum(
            len(runs) for each in partly for runs in each.common_runs.values()
        )
        found.append(
            f"Tables and figures leave out {left_out} of {len(results.runs)} runs, because not all controllers have "
            f"runs of their blocks: {_lacking(partly)}."
        )
    if apart := [each for each in compared if not each.common]:
        found.append(
            f"Over {_networks(apart)}, no block has runs of all controllers: their means cover different inputs and "
            f"cannot be compared ({_lacking(apart)})."
        )
    return found


def _lacking(compared: Sequence[Comparison]) -> str:
    missing = sum((Counter(each.missing) for each in compared), Counter[Controller]())
    parts = (f"{controller.title} lacks {count}" for controller, count in missing.most_common())
    return ", ".join(parts)


def _networks(compared: Sequence[Comparison]) -> str:
    labels = (next(iter(each.runs.values()))[0].record.configuration.network.label for each in compared)
    return ", ".join(dict.fromkeys(labels))


def _changed(results: Results) -> list[tuple[str, str]]:
    """Kind and name of inputs with different contents in different runs."""
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
    """Values that rows, lines and points pool."""
    configurations = [run.record.configuration for run in results.runs]
    return {
        "durations": sorted({f"{each.duration_s:g} s" for each in configurations}),
        "viewports": sorted({f"{each.width}×{each.height}" for each in configurations}),
        "trace positions": sorted(
            {f"{each.network.offset_s:g} s" for each in configurations if each.network.trace is not None}
            if not any(each.segment for each in configurations)  # segments are blocks
            else ()
        ),
    }
