"""Loads an experiment's folder: runs with figures and time series, and failed runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import StartError
from tigas_experiments.records import statistics
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import ExperimentRecord, RunRecord, read_experiment
from tigas_experiments.records.rerendered import SampledRun, sampled_run
from tigas_experiments.records.scores import Score
from tigas_experiments.records.summary import Records, read
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.latency_parts import LatencyParts
from tigas_experiments.report.metrics import METRICS, Measured, Value

LADDER = "ladder.jpg"
"""One view of the experiment at each rung, made by `tigas quality ladder`."""
Floats = NDArray[np.float64]
OnProgress = Callable[[str, int, int | None], None]
"""Progress callback: current step, amount done, and total if known."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A complete run."""

    folder: str
    record: RunRecord
    values: Mapping[str, Value]
    """Figures by the names of `METRICS`."""
    profile_shares: Mapping[int, float]
    """Share of time on the screen by profile."""
    latencies: Floats
    """[inputs, 2] Sample time, s; motion-to-photon, ms, inf for unanswered inputs."""
    frame_ages: Floats
    """[frames, 2] Display time, s; age of the frame's pose at that time, ms."""
    heights: Floats
    """[frames, 2] Display time, s; height, pixels."""
    received: Floats
    """[samples, 2] Time, s; cumulative bytes."""
    link: Floats
    """[samples, 2] Time, s; link rate, Mbit/s."""
    display_ssim: Floats
    """[pictures, 2] Capture time, s; SSIM at display time."""
    scores: tuple[Score, ...]
    """Scores of its sampled pictures."""
    scores_problem: str | None
    """Reason why the scores are unreadable."""

    @classmethod
    def of(cls, folder: str, measured: Measured, records: Records) -> Run:
        """A run from its records."""
        inputs, frames = records.inputs, records.frames
        answers = zip(inputs, statistics.answers(inputs, frames), strict=True)
        ages = statistics.ages_when_new(inputs, frames)
        return cls(
            folder=folder,
            record=measured.record,
            values={name: metric.of(measured) for name, metric in METRICS.items()},
            profile_shares=measured.figures.rungs.share,
            latencies=_array([(entry.at / 1000, ms) for entry, ms in answers]),
            frame_ages=_array([(at / 1000, ms) for at, ms in ages]),
            heights=_array([(frame.at / 1000, frame.height) for frame in frames]),
            received=_array([(entry.at / 1000, entry.bytes) for entry in records.traffic]),
            link=_array([(at.at / 1000, at.target_kbps / 1000) for at in records.link]),
            display_ssim=_array([(one.at / 1000, one.seen.ssim) for one in records.quality if one.seen is not None]),
            scores=tuple(records.scores),
            scores_problem=records.scores_problem,
        )

    @property
    def controller(self) -> Controller:
        """The controller or stream under comparison."""
        return Controller.of(self.record.configuration)

    @property
    def saturated(self) -> bool:
        """Whether the machine is known to have been a bottleneck."""
        return self.record.load is not None and self.record.load.saturated


@dataclass(frozen=True, slots=True)
class Failure:
    """A run without figures."""

    folder: str
    reason: str
    record: RunRecord | None
    """None if run.json is unreadable."""


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Contents of an experiment's folder."""

    folder: Path
    experiment: ExperimentRecord | None
    """None for a hand-made folder or an unreadable record: the report only needs runs."""
    runs: tuple[Run, ...]
    """Sorted by folder name."""
    failures: tuple[Failure, ...]

    @property
    def title(self) -> str:
        """The experiment's name."""
        return self.folder.resolve().name if self.experiment is None else self.experiment.name


def load(folder: Path, on_progress: OnProgress = lambda step, done, total: None) -> Results:
    """Read all runs of an experiment. Raises StartError if there are none."""
    folders = run_folders(folder)
    experiment: ExperimentRecord | None = None
    with suppress(BrokenRecording):
        experiment = read_experiment(folder)
    runs: list[Run] = []
    failures: list[Failure] = []

    def relative(reason: str) -> str:
        """Remove the experiment's path, so that a report does not depend on its location."""
        return reason.replace(f"{folder}{os.sep}", "")

    for done, each in enumerate(folders, 1):
        try:
            summary, records = read(each)
            if summary.figures is None or records is None:
                failures.append(Failure(each.name, relative(summary.problem or "It has no figures."), summary.record))
            else:
                if records.scores_problem is not None:
                    records = replace(records, scores_problem=relative(records.scores_problem))
                parts = LatencyParts.of(records.inputs, records.frames, records.replies)
                runs.append(Run.of(each.name, Measured(summary.record, summary.figures, parts), records))
        except BrokenRecording as error:
            failures.append(Failure(each.name, relative(str(error)), None))
        on_progress("reads runs", done, len(folders))
    return Results(folder, experiment, tuple(runs), tuple(failures))


def sampled_runs(results: Results) -> dict[str, SampledRun]:
    """Sample records of complete runs that have samples, by folder name."""
    found = ((run.folder, sampled_run(results.folder / "runs" / run.folder)) for run in results.runs)
    return {folder: run for folder, run in found if run.samples}


def run_folders(folder: Path) -> list[Path]:
    """Folders of an experiment's runs, sorted by name, without hidden ones. Raises StartError if there are none."""
    where = folder / "runs"
    try:
        found = sorted(path for path in where.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError as error:
        reason = error.strerror or error
        raise StartError(f"{where} cannot be read ({reason}); a report needs an experiment's folder.") from None
    if not found:
        raise StartError(f"{where} has no runs yet.")
    return found


def _array(rows: Sequence[tuple[float, float]]) -> Floats:
    return np.array(rows, dtype=float).reshape(-1, 2)
