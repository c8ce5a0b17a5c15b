"""The runs of an experiment's folder, and what those of equal network, round trip and controller have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from tigas_common.errors import StartError
from tigas_common.wire.figures import Figures
from tigas_experiments.records import statistics
from tigas_experiments.records.folder import RunRecord, read_experiment
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.summary import Records, Summary, read
from tigas_experiments.report.metrics import Metric, Value
from tigas_experiments.report.variants import Variant, in_order

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A complete run."""

    folder: str
    record: RunRecord
    figures: Figures
    latencies: Floats
    """[inputs] Motion-to-photon, ms; inf where no frame came."""
    responses: Floats
    """[frames, 2] When it was on the screen, s; how old its pose was then, ms."""
    received: Floats
    """[samples, 2] s; bytes by then."""
    link: Floats
    """[samples, 3] s; the link's rate and what it delivered since the sample before, Mbit/s."""

    @classmethod
    def of(cls, folder: str, record: RunRecord, figures: Figures, records: Records) -> Run:
        """From what was read."""
        link = [(sample.at / 1000, sample.target_kbps / 1000, sample.delivered_kbps / 1000) for sample in records.link]
        return cls(
            folder=folder,
            record=record,
            figures=figures,
            latencies=np.array(statistics.answers(records.inputs, records.frames), dtype=float),
            responses=_table([(at / 1000, ms) for at, ms in _responses(records)], 2),
            received=_table([(entry.at / 1000, float(entry.bytes)) for entry in records.traffic], 2),
            link=_table(link, 3),
        )

    @property
    def saturated(self) -> bool:
        """Whether the machine was the bottleneck at times, as far as is known."""
        return self.record.load is not None and self.record.load.saturated


@dataclass(frozen=True, slots=True)
class Condition:
    """What a run was made under, but for its scene, movement and repeat."""

    network: str
    """Without its round trip."""
    rtt_ms: float | None
    """None: the trace's own, or unknown."""
    variant: Variant

    @classmethod
    def of(cls, record: RunRecord) -> Condition:
        """Of a run."""
        network = record.configuration.network
        return cls(network.name, network.round_trip_ms, Variant.of(record.configuration))


@dataclass(frozen=True, slots=True)
class Spread:
    """A figure over several runs."""

    mean: float
    low: float
    high: float
    runs: int
    """That have the figure."""
    ci95: float | None
    """Half of the 95 % confidence interval of the mean, by Student's t; None with fewer than two runs."""

    @classmethod
    def over(cls, values: Sequence[Value]) -> Spread | None:
        """Without the runs that do not have it; None if none has. inf in one makes the mean inf."""
        found = [value for value in values if value is not None]
        if not found:
            return None
        ci95 = None
        if len(found) > 1 and all(map(math.isfinite, found)):
            ci95 = float(t.ppf(0.975, len(found) - 1) * np.std(found, ddof=1) / math.sqrt(len(found)))
        low, high = min(found), max(found)
        # Rounding must not carry the mean of equal values beyond them.
        return cls(min(max(sum(found) / len(found), low), high), low, high, len(found), ci95)


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """All runs of one condition."""

    condition: Condition
    runs: tuple[Run, ...]

    @property
    def variant(self) -> Variant:
        """What was compared."""
        return self.condition.variant

    @property
    def saturated(self) -> bool:
        """Whether the machine was the bottleneck in a run."""
        return any(run.saturated for run in self.runs)

    def spread(self, metric: Metric) -> Spread | None:
        """Of one figure."""
        return Spread.over([metric.of(run.record, run.figures) for run in self.runs])

    def has(self, metric: Metric) -> bool:
        """Whether all runs have the figure."""
        return all(metric.of(run.record, run.figures) is not None for run in self.runs)

    @property
    def latencies(self) -> Floats:
        """[inputs] Of all runs together, ms."""
        return np.concatenate([run.latencies for run in self.runs])

    @property
    def responses(self) -> Floats:
        """[frames] Of all runs together, ms."""
        return np.concatenate([run.responses[:, 1] for run in self.runs])


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

    title: str
    planned: int | None
    """How many runs there will be when it is complete; None if it is not known."""
    runs: tuple[Run, ...]
    failures: tuple[Failure, ...]
    groups: tuple[Group, ...]
    """By network, round trip and variant."""

    @property
    def networks(self) -> list[str]:
        """By name."""
        return list(dict.fromkeys(group.condition.network for group in self.groups))

    @property
    def variants(self) -> list[Variant]:
        """In the order of every table and legend."""
        return in_order(group.variant for group in self.groups)

    def rtts(self, network: str) -> list[float]:
        """The round trips that are known, from the lowest."""
        found = {group.condition.rtt_ms for group in self.groups if group.condition.network == network}
        return sorted(rtt for rtt in found if rtt is not None)

    def at(self, network: str, rtt_ms: float | None) -> list[Group]:
        """The groups of one network and round trip."""
        return [g for g in self.groups if (g.condition.network, g.condition.rtt_ms) == (network, rtt_ms)]

    def base_rtt(self, network: str) -> float | None:
        """The round trip that stands for the network where only one is shown: the lowest."""
        return next(iter(self.rtts(network)), None)


def load(folder: Path, heard: Callable[[int, int], None] = lambda done, total: None) -> Results:
    """Read all runs; `heard` is told how many of how many are read. Raises StartError if there is none."""
    folders = run_folders(folder)
    runs: list[Run] = []
    failures: list[Failure] = []
    for done, each in enumerate(folders, 1):
        try:
            summary, records = read(each)
            if summary.figures is None or records is None:
                failures.append(_failure(summary))
            else:
                runs.append(Run.of(each.name, summary.record, summary.figures, records))
        except BrokenRecording as error:
            failures.append(Failure(each.name, str(error), None))
        heard(done, len(folders))
    return Results(*_plan(folder), tuple(runs), tuple(failures), tuple(_groups(runs)))


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


def _groups(runs: Iterable[Run]) -> list[Group]:
    by_condition: dict[Condition, list[Run]] = {}
    for run in runs:
        by_condition.setdefault(Condition.of(run.record), []).append(run)
    order = in_order(condition.variant for condition in by_condition)

    def place(condition: Condition) -> tuple[str, float, int]:
        rtt = -1.0 if condition.rtt_ms is None else condition.rtt_ms
        return condition.network, rtt, order.index(condition.variant)

    return [Group(condition, tuple(by_condition[condition])) for condition in sorted(by_condition, key=place)]


def _responses(records: Records) -> list[tuple[float, float]]:
    return statistics.response_times(records.inputs, records.frames)


def _table(rows: Sequence[tuple[float, ...]], columns: int) -> Floats:
    return np.array(rows, dtype=float).reshape(-1, columns)


def _failure(summary: Summary) -> Failure:
    return Failure(summary.folder, summary.problem or "It has no figures.", summary.record)


def _plan(folder: Path) -> tuple[str, int | None]:
    """What the experiment is called, and how many runs it is to have."""
    try:
        record = read_experiment(folder)
    except BrokenRecording:  # a comparison made by hand, or a record that broke off: the runs are what counts
        return folder.resolve().name, None
    return record.name, record.planned
