"""Loads what lies in an experiment's folder: its runs with their figures and time series, and those without result."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import StartError
from tigas_common.wire.figures import Figures
from tigas_common.wire.recording import Input
from tigas_experiments.records import statistics
from tigas_experiments.records.folder import ExperimentRecord, RunRecord, read_experiment
from tigas_experiments.records.materialised import SampledRun, sampled_run
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.scores import Score
from tigas_experiments.records.summary import Records, read
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.latency_parts import LatencyParts

LADDER = "ladder.jpg"
"""The view of an experiment at each rung, if somebody asked for it (`tigas quality ladder`)."""
Floats = NDArray[np.float64]
Told = Callable[[str, int, int | None], None]
"""Who wants to know how far a report is: what goes on, how much of it is done, and of how much, if that is known."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A complete run."""

    folder: str
    record: RunRecord
    figures: Figures
    latencies: Floats
    """[inputs, 2] When it was sampled, s; motion-to-photon, ms, inf where no frame came."""
    frame_ages: Floats
    """[frames, 2] When it was on the screen, s; how old its pose was then, ms."""
    heights: Floats
    """[frames, 2] When it was on the screen, s; its height, pixels."""
    received: Floats
    """[samples, 2] s; bytes by then."""
    link: Floats
    """[samples, 3] s; the link's rate and what it delivered since the sample before, Mbit/s."""
    turned: Floats
    """[inputs, 2] s; how far the viewer had turned by then, degrees."""
    seen: Floats
    """[pictures, 2] When it was kept, s; SSIM of what was seen."""
    parts: LatencyParts | None
    """Of the frames' age; None without the server's times."""
    scores: tuple[Score, ...]
    """Of its sampled pictures, as far as they were computed."""
    scores_problem: str | None
    """Why they cannot be read."""

    @classmethod
    def of(cls, folder: str, record: RunRecord, figures: Figures, records: Records) -> Run:
        """From what was read."""
        inputs, frames = records.inputs, records.frames
        answers = zip(inputs, statistics.answers(inputs, frames), strict=True)
        ages = statistics.ages_when_new(inputs, frames)
        return cls(
            folder=folder,
            record=record,
            figures=figures,
            latencies=_table([(entry.at / 1000, ms) for entry, ms in answers], 2),
            frame_ages=_table([(at / 1000, ms) for at, ms in ages], 2),
            heights=_table([(frame.at / 1000, frame.height) for frame in frames], 2),
            received=_table([(entry.at / 1000, entry.bytes) for entry in records.traffic], 2),
            link=_table([(at.at / 1000, at.target_kbps / 1000, at.delivered_kbps / 1000) for at in records.link], 3),
            turned=_turned(inputs),
            seen=_table([(one.at / 1000, one.seen.ssim) for one in records.quality if one.seen is not None], 2),
            parts=LatencyParts.of(inputs, frames, records.replies),
            scores=tuple(records.scores),
            scores_problem=records.scores_problem,
        )

    @property
    def controller(self) -> Controller:
        """What was compared."""
        return Controller.of(self.record.configuration)

    @property
    def saturated(self) -> bool:
        """Whether the machine was the bottleneck at times, as far as is known."""
        return self.record.load is not None and self.record.load.saturated


@dataclass(frozen=True, slots=True)
class Failure:
    """A run without figures."""

    folder: str
    reason: str
    record: RunRecord | None
    """None if not even run.json can be read."""


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """What lies in an experiment's folder."""

    folder: Path
    experiment: ExperimentRecord | None
    """None of a folder that was made by hand, or whose record broke off: the runs are what counts."""
    runs: tuple[Run, ...]
    """By the names of their folders."""
    failures: tuple[Failure, ...]

    @property
    def title(self) -> str:
        """What the experiment is called."""
        return self.folder.resolve().name if self.experiment is None else self.experiment.name


def load(folder: Path, told: Told = lambda what, done, total: None) -> Results:
    """Read all runs. Raises StartError if there is none."""
    folders = run_folders(folder)
    experiment: ExperimentRecord | None = None
    with suppress(BrokenRecording):
        experiment = read_experiment(folder)
    runs: list[Run] = []
    failures: list[Failure] = []

    def within(reason: str) -> str:
        """Without the path to the experiment's folder, so that a report is the same wherever the folder lies."""
        return reason.replace(f"{folder}{os.sep}", "")

    for done, each in enumerate(folders, 1):
        try:
            summary, records = read(each)
            if summary.figures is None or records is None:
                failures.append(Failure(each.name, within(summary.problem or "It has no figures."), summary.record))
            else:
                if records.scores_problem is not None:
                    records = replace(records, scores_problem=within(records.scores_problem))
                runs.append(Run.of(each.name, summary.record, summary.figures, records))
        except BrokenRecording as error:
            failures.append(Failure(each.name, within(str(error)), None))
        told("reads runs", done, len(folders))
    return Results(folder, experiment, tuple(runs), tuple(failures))


def sampled_runs(results: Results) -> dict[str, SampledRun]:
    """What is known of the samples of complete runs that have some, by the names of their folders."""
    found = ((run.folder, sampled_run(results.folder / "runs" / run.folder)) for run in results.runs)
    return {folder: run for folder, run in found if run.samples}


def run_folders(folder: Path) -> list[Path]:
    """The folders of the runs, by name; hidden ones are no runs yet. Raises StartError if there is none."""
    where = folder / "runs"
    try:
        found = sorted(path for path in where.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError as error:
        reason = error.strerror or error
        raise StartError(f"{where} cannot be read ({reason}); a report needs an experiment's folder.") from None
    if not found:
        raise StartError(f"{where} has no runs yet.")
    return found


def _turned(inputs: Sequence[Input]) -> Floats:
    """The angles between the inputs' orientations, added up: whichever way the viewer turned, on the shorter way."""
    every = np.array([entry.quaternion for entry in inputs], dtype=float).reshape(-1, 4)
    every /= np.linalg.norm(every, axis=1, keepdims=True)
    steps = 2 * np.degrees(np.arccos(np.abs(np.sum(every[1:] * every[:-1], axis=1)).clip(max=1)))
    total = np.concatenate(([0.0], np.cumsum(steps)))[: len(every)]
    return np.column_stack(([entry.at / 1000 for entry in inputs], total)).reshape(-1, 2)


def _table(rows: Sequence[tuple[float, ...]], columns: int) -> Floats:
    return np.array(rows, dtype=float).reshape(-1, columns)
