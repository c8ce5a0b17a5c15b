"""The run table: one row per run with its configuration, machine and metrics. All of a report derives from it.

`runs.csv` is this table; the runs of a report also have time series, used only by figures.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import StartError
from tigas_experiments.records import statistics
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import ExperimentRecord, RunRecord, read_experiment
from tigas_experiments.records.samples import SampledRun, read_sampled_run
from tigas_experiments.records.scores import Score
from tigas_experiments.records.summary import Records, read
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.metrics import METRICS, Value
from tigas_experiments.wire.run import Configuration

RUNS = "runs"
Floats = NDArray[np.float64]
Row = dict[str, Any]
OnProgress = Callable[[str, int, int | None], None]
"""Progress callback: current step, amount done, and total if known."""


class Block(NamedTuple):
    """Inputs of a run apart from its controller: part of a network trace × part of a movement × scene.

    Repeats share a block: they measure how much a run varies, not how inputs differ.
    """

    network: str
    """Name without the round trip."""
    trace_offset_s: float | None
    """None without a trace."""
    scene: str
    movement: str
    movement_offset_s: float

    @classmethod
    def from_configuration(cls, configuration: Configuration) -> Block:
        network, movement = configuration.network, Path(configuration.movement).name
        offset_s = None if network.trace is None else network.offset_s
        return cls(network.name, offset_s, configuration.scene, movement, configuration.movement_offset_s)

    @property
    def window(self) -> tuple[object, ...]:
        """Part of a network trace, shared with other blocks; for a constant link, part of a movement."""
        if self.trace_offset_s is None:
            return self.network, self.movement, self.movement_offset_s
        return self.network, self.trace_offset_s


class Condition(NamedTuple):
    """Conditions of a run apart from its scene, movement and repeat."""

    network: str
    """Name without the round trip."""
    rtt_ms: float | None
    """None if it varies with the trace or is unknown."""
    controller: Controller

    @classmethod
    def from_record(cls, record: RunRecord) -> Condition:
        network = record.configuration.network
        return cls(network.name, network.round_trip_ms, Controller.from_configuration(record.configuration))

    @property
    def labels(self) -> list[str]:
        """Network and round trip as cells of a table."""
        return [self.network, "varies" if self.rtt_ms is None else f"{self.rtt_ms:g}"]


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A run with a readable record."""

    folder: Path
    record: RunRecord
    block: Block
    sampled: SampledRun
    problem: str | None = None
    """Reason for missing metrics."""
    values: Mapping[str, Value] = field(default_factory=dict)
    """Metrics by name in `METRICS`; empty without a result."""
    profile_shares: Mapping[int, float] = field(default_factory=dict)
    """Share of time on screen by profile."""
    series: Mapping[str, Floats] = field(default_factory=dict)
    scores: Sequence[Score] = ()
    """Scores of the run's sampled pictures."""
    scores_problem: str | None = None
    """Reason why the scores are unreadable."""

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def configuration(self) -> Configuration:
        return self.record.configuration

    @property
    def saturated(self) -> bool:
        """Whether the machine is known to have been a bottleneck."""
        return self.record.load is not None and self.record.load.saturated


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    folder: Path
    experiment: ExperimentRecord | None
    """None for a hand-made folder or an unreadable record, as a report only needs runs."""
    made: tuple[Run, ...]
    """All runs with a readable record, in the order in which they were made."""
    failures: Mapping[str, str]
    """Reasons for missing metrics by folder name, including runs without a readable record."""

    @property
    def runs(self) -> list[Run]:
        """Complete runs, by folder name."""
        return sorted((run for run in self.made if run.problem is None), key=lambda run: run.name)

    @property
    def title(self) -> str:
        return self.folder.resolve().name if self.experiment is None else self.experiment.name


def load_results(folder: Path, on_progress: OnProgress = lambda step, done, total: None) -> Results:
    """Read all runs of an experiment. Raises StartError without runs."""
    folders = run_folders(folder)
    experiment: ExperimentRecord | None = None
    with suppress(BrokenRecording):
        experiment = read_experiment(folder)
    made: list[Run] = []
    failures: dict[str, str] = {}

    def relative(reason: str) -> str:
        """Remove the experiment's path, so that a report does not depend on its location."""
        return reason.replace(f"{folder}{os.sep}", "")

    for done, each in enumerate(folders, 1):
        try:
            made.append(_read(each, relative))
        except BrokenRecording as error:
            failures[each.name] = relative(str(error))
        on_progress("reads runs", done, len(folders))
    failures |= {run.name: run.problem for run in made if run.problem is not None}
    made.sort(key=lambda run: (run.record.started, run.name))
    return Results(folder, experiment, tuple(made), dict(sorted(failures.items())))


def run_folders(folder: Path) -> list[Path]:
    """Folders of an experiment's runs, sorted by name, without hidden ones. Raises StartError if there are none."""
    where = folder / RUNS
    try:
        found = sorted(path for path in where.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError as error:
        reason = error.strerror or error
        raise StartError(f"{where} cannot be read ({reason}); a report needs an experiment's folder.") from None
    if not found:
        raise StartError(f"{where} has no runs yet.")
    return found


def run_table(results: Results, compared: Collection[Run]) -> list[Row]:
    """All runs, sorted by folder; `compared` are the runs included in means and differences."""
    rows: dict[str, Row] = {
        name: {"folder": name, "status": "broken", "problem": reason} for name, reason in results.failures.items()
    }
    for run in results.made:
        broken = run.problem is not None and run.record.status == "complete"
        rows[run.name] = {
            "folder": run.name,
            "status": "broken" if broken else run.record.status,
            "problem": run.problem or "",
            "compared": run in compared if run.problem is None else None,
            **_record(run.record),
            **run.values,
            **{f"profile_{profile}_pct": 100 * share for profile, share in run.profile_shares.items()},
        }
    return [row for _, row in sorted(rows.items())]


def _record(record: RunRecord) -> Row:
    network, rtt_ms, controller = Condition.from_record(record)
    load = record.load
    busiest = None if load is None else load.worst_pegged
    return {
        "network": network,
        "rtt_ms": rtt_ms,
        "controller": controller.name,
        **_flatten("configuration", record.configuration.model_dump(mode="json")),
        "started": record.started,
        "tigas": record.machine.tigas,
        "commit": record.machine.commit,
        "browser": record.browser,
        "link_made_by": record.backend,
        "scene_bytes": record.scene_bytes,
        "scene_sha256": record.scene_sha256,
        "processors": record.machine.processors,
        "processors_usable": load and load.processors,
        "processors_busy_pct": load and 100 * load.cpu_mean,
        "saturated_pct": load and 100 * load.saturated_share,
        "saturated": load and load.saturated,
        "pegged_thread_of": busiest and busiest[0],
        "pegged_thread_pct": busiest and 100 * busiest[1],
        "services_watched": load and load.services,
    }


def _flatten(prefix: str, value: Any) -> Row:
    """Nested fields as columns, such as configuration_network_link_down_kbps."""
    if isinstance(value, dict):
        return {name: cell for key, inner in value.items() for name, cell in _flatten(f"{prefix}_{key}", inner).items()}
    return {prefix: value}


def _read(folder: Path, relative: Callable[[str], str]) -> Run:
    """Read one run. Raises BrokenRecording."""
    summary, records = read(folder)
    run = Run(folder, summary.record, Block.from_configuration(summary.record.configuration), read_sampled_run(folder))
    if summary.figures is None or records is None:
        return replace(run, problem=relative(summary.problem or ""))
    return replace(
        run,
        values={name: summary.figures.values.get(name) for name in METRICS},
        profile_shares=summary.figures.rungs,
        series=_series(records),
        scores=records.scores,
        scores_problem=relative(records.scores_problem or "") or None,
    )


def _series(records: Records) -> dict[str, Floats]:
    """Time series [n, 2] of time in s and a value.

    `latency`: motion-to-photon of each input, ms, inf for unanswered ones. `age`: of a frame's pose at display, ms.
    `height`: of frames, pixels. `received`: cumulative bytes. `link`: rate, Mbit/s. `ssim`: at display time.
    """
    inputs, frames = records.recording.inputs, records.recording.frames
    answers = zip(inputs, statistics.answer_times(inputs, frames), strict=True)
    points: dict[str, list[tuple[float, float]]] = {
        "latency": [(entry.at, ms) for entry, ms in answers],
        "age": statistics.new_view_ages(inputs, frames),
        "height": [(frame.at, frame.height) for frame in frames],
        "received": [(entry.at, entry.bytes) for entry in records.recording.traffic],
        "link": [(sample.at, sample.target_kbps / 1000) for sample in records.link],
        "ssim": [(one.at, one.seen.ssim) for one in records.quality if one.seen is not None],
    }
    return {name: np.array(rows, dtype=float).reshape(-1, 2) / (1000, 1) for name, rows in points.items()}
