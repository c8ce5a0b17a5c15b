"""Scores of sampled pictures over runs: mean and standard deviation for each controller, network and model."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from tigas_experiments.quality.metrics import PICTURE_METRICS, Name, PictureMetric
from tigas_experiments.records.scores import Score
from tigas_experiments.report.groups import Condition, Groups

What = Literal["original", "enhanced", "difference", "seen"]
"""The difference is the enhanced picture's score less the original's, sample by sample."""


@dataclass(frozen=True, slots=True)
class Mean:
    """Over pictures."""

    mean: float
    deviation: float | None
    """Of the pictures, not of the mean; None of a single one."""
    pictures: int

    def text(self, metric: PictureMetric, *, signed: bool = False) -> str:
        """As a person reads it, without the unit."""
        mean = f"{self.mean:{'+' if signed else ''}z.{metric.digits}f}"
        return mean if self.deviation is None else f"{mean} ± {self.deviation:.{metric.digits}f}"


@dataclass(slots=True)
class Row:
    """Pictures that are told of together."""

    condition: Condition | None
    """None of pictures of which no run is known."""
    what: What
    model: str | None
    """What enhanced them, if anything says it."""
    runs: int = 0
    values: dict[Name, list[float]] = field(default_factory=dict)

    def mean(self, metric: PictureMetric) -> Mean | None:
        """None if nothing was computed."""
        found = self.values.get(metric.name)
        if not found:
            return None
        deviation = statistics.stdev(found) if len(found) > 1 else None
        return Mean(statistics.fmean(found), deviation, len(found))


def rows(runs: Iterable[tuple[Condition | None, Sequence[Score]]]) -> list[Row]:
    """Of runs with the scores of each: the originals of each condition, then what enhanced them, then differences."""
    found: dict[tuple[Condition | None, What, str | None], Row] = {}
    for condition, scores in runs:
        by_key = {score.key: score for score in scores}
        touched: set[int] = set()

        def add(
            what: What,
            model: str | None,
            values: dict[Name, float],
            condition: Condition | None = condition,
            touched: set[int] = touched,
        ) -> None:
            row = found.setdefault((condition, what, model), Row(condition, what, model))
            row.runs += id(row) not in touched
            touched.add(id(row))
            for name, value in values.items():
                row.values.setdefault(name, []).append(value)

        for score in scores:
            add(score.picture, score.model, score.values)
            original = by_key.get((score.seq, "original"))
            if score.picture == "enhanced" and original is not None:
                both = score.values.keys() & original.values.keys()
                add("difference", score.model, {name: score.values[name] - original.values[name] for name in both})
    conditions = list(dict.fromkeys(condition for condition, *_ in found))
    order: tuple[What, ...] = ("original", "enhanced", "difference", "seen")
    return sorted(
        found.values(), key=lambda row: (conditions.index(row.condition), order.index(row.what), row.model or "")
    )


def rows_of(groups: Groups) -> list[Row]:
    """Of all runs of an experiment, in the order of its tables."""
    return rows((group.condition, run.scores) for group in groups for run in group.runs if run.scores)


def computed(rows: Sequence[Row]) -> list[PictureMetric]:
    """The metrics that at least one of them has."""
    return [metric for metric in PICTURE_METRICS if any(row.values.get(metric.name) for row in rows)]
