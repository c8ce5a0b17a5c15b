"""Scores of sampled pictures: mean and standard deviation for each controller, network and model."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from tigas_experiments.quality.metrics import PICTURE_METRICS, Name, PictureMetric
from tigas_experiments.records.scores import Score
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.run_table import Condition

PictureKind = Literal["original", "enhanced", "difference", "seen"]
"""`difference` is the enhanced picture's score minus the original's, per sample."""
ORDER: tuple[PictureKind, ...] = ("original", "enhanced", "difference", "seen")


@dataclass(frozen=True, slots=True)
class Mean:
    mean: float
    deviation: float | None
    """Standard deviation over pictures; None for a single one."""
    pictures: int

    def text(self, metric: PictureMetric, *, signed: bool = False) -> str:
        mean = f"{self.mean:{'+' if signed else ''}z.{metric.digits}f}"
        return mean if self.deviation is None else f"{mean} ± {self.deviation:.{metric.digits}f}"


@dataclass(slots=True)
class Row:
    """Scores of pictures of one condition, kind and model."""

    condition: Condition | None
    """None for pictures from an unknown run."""
    kind: PictureKind
    model: str | None
    """The enhancement model, if known."""
    runs: int = 0
    values: dict[Name, list[float]] = field(default_factory=dict)

    def mean(self, metric: PictureMetric) -> Mean | None:
        """Mean of a metric; None if it was not computed."""
        found = self.values.get(metric.name)
        if not found:
            return None
        deviation = statistics.stdev(found) if len(found) > 1 else None
        return Mean(statistics.fmean(found), deviation, len(found))


def score_rows(runs: Iterable[tuple[Condition | None, Sequence[Score]]]) -> list[Row]:
    """Rows of all runs; within each condition: originals, enhanced pictures, then differences."""
    found: dict[tuple[Condition | None, PictureKind, str | None], Row] = {}
    for condition, scores in runs:
        by_key = {score.key: score for score in scores}
        counted = set()
        for score in scores:
            pictures: list[tuple[PictureKind, dict[Name, float]]] = [(score.picture, score.values)]
            original = by_key.get((score.seq, "original"))
            if score.picture == "enhanced" and original is not None:
                both = score.values.keys() & original.values.keys()
                pictures.append(("difference", {name: score.values[name] - original.values[name] for name in both}))
            for kind, values in pictures:
                key = (condition, kind, score.model)
                row = found.setdefault(key, Row(*key))
                row.runs += key not in counted
                counted.add(key)
                for name, value in values.items():
                    row.values.setdefault(name, []).append(value)
    conditions = list(dict.fromkeys(condition for condition, *_ in found))
    return sorted(
        found.values(), key=lambda row: (conditions.index(row.condition), ORDER.index(row.kind), row.model or "")
    )


def rows_of(groups: Groups) -> list[Row]:
    """Rows of an experiment, in the order of its tables."""
    return score_rows((group.condition, run.scores) for group in groups for run in group.runs if run.scores)


def computed_metrics(rows: Sequence[Row]) -> list[PictureMetric]:
    return [metric for metric in PICTURE_METRICS if any(row.values.get(metric.name) for row in rows)]
