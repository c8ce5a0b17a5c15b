"""Quality against rate: curves through fixed rungs, and differences from them at equal rates."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tigas_experiments.report.controllers import Controller, sort_controllers
from tigas_experiments.report.estimates import Estimate
from tigas_experiments.report.groups import ALL, Group, Groups
from tigas_experiments.report.metrics import METRICS, Metric, select_metrics
from tigas_experiments.report.run_table import Block

RECEIVED = METRICS["received_mbit_s"]
QUALITIES = select_metrics("seen_ssim", "seen_psnr_db", "picture_ssim", "picture_psnr_db")
Sample = dict[Metric, float]
"""Rate (RECEIVED, above 0) and qualities of a block."""
Points = list[tuple[float, float]]
"""Rate (Mbit/s) and quality, by ascending rate."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """An adaptive controller, or all fixed rungs of a mode, which form a curve if there are several."""

    samples: Mapping[Controller, Mapping[Block, Sample]]

    @property
    def is_curve(self) -> bool:
        return len(self.samples) > 1

    @property
    def title(self) -> str:
        first = next(iter(self.samples))
        if not self.is_curve:
            return first.title
        name = "Fixed rungs" if first.mode == "stateless" else f"{first.mode_title}, fixed"
        return " + ".join((name, *first.stages))

    def values(self, controller: Controller, metric: Metric, having: Metric | None = None) -> dict[Block, float]:
        """Values of a controller's blocks that have the metric and, optionally, another metric."""
        samples = self.samples[controller].items()
        return {block: own[metric] for block, own in samples if metric in own and (having or metric) in own}

    def points(self, block: Block, metric: Metric) -> Points:
        """Points of one block; empty for a curve with fewer than two."""
        samples = (own[block] for own in self.samples.values() if block in own)
        found = sorted((sample[RECEIVED], sample[metric]) for sample in samples if metric in sample)
        return found if len(found) > 1 or not self.is_curve else []


@dataclass(frozen=True, slots=True, eq=False)
class EqualRate:
    """A series compared with a curve at equal rates."""

    curve: Series
    other: Series
    blocks: int
    """Number of blocks in which both have a quality."""
    ranges: Sequence[tuple[float, float]]
    """Compared rates in Mbit/s, for the blocks in which they overlap."""
    differences: Mapping[Metric, Estimate | None]
    """Quality of the series minus that of the curve, over the overlapping blocks."""

    @classmethod
    def from_series(cls, curve: Series, other: Series) -> EqualRate:
        values: dict[Metric, dict[Block, float]] = {metric: {} for metric in QUALITIES}
        ranges: dict[Block, tuple[float, float] | None] = {}
        for block in dict.fromkeys(block for samples in other.samples.values() for block in samples):
            for metric in QUALITIES:
                one, two = curve.points(block, metric), other.points(block, metric)
                if one and two:
                    low, high = max(one[0][0], two[0][0]), min(one[-1][0], two[-1][0])
                    ranges.setdefault(block, None)
                    if low <= high:
                        ranges[block] = (low, high)
                        values[metric][block] = _mean_over(low, high, one, two)
        estimates = {metric: Estimate.from_blocks(values[metric], metric.step) for metric in QUALITIES}
        return cls(curve, other, len(ranges), [each for each in ranges.values() if each], estimates)

    @property
    def rates(self) -> tuple[float, float] | None:
        """Lowest and highest compared rate in Mbit/s; None if rates overlap in no block."""
        return (min(low for low, _ in self.ranges), max(high for _, high in self.ranges)) if self.ranges else None

    @property
    def labels(self) -> list[str]:
        """First cells of its row: titles and, if there is an overlap, the rates and blocks."""
        titles = [self.curve.title, self.other.title]
        return [*titles, _range(*self.rates), f"{len(self.ranges)} of {self.blocks}"] if self.rates else titles

    def estimate(self, metric: Metric) -> Estimate | None:
        return self.differences[metric]

    @property
    def no_overlap(self) -> str:
        """Explanation of a missing difference; empty if there is a difference."""
        if self.rates:
            return ""
        ranges = []
        for series in (self.curve, self.other):
            means = [float(np.mean([*series.values(each, RECEIVED).values()])) for each in series.samples]
            ranges.append(f"{series.title} {_range(min(means), max(means))}")
        return f"no overlap: {', '.join(ranges)} Mbit/s"


@dataclass(frozen=True, slots=True, eq=False)
class RateDistortion:
    """All series of one network and round trip, or of all networks."""

    network: str
    rtt_ms: float | None
    series: Sequence[Series]
    """Curves first."""

    @classmethod
    def from_groups(cls, groups: Sequence[Group], network: str, rtt_ms: float | None) -> RateDistortion | None:
        """Series of groups with different controllers and possibly networks; None without measured quality."""
        samples: dict[Controller, dict[Block, Sample]] = {}
        for group in groups:
            rates = group.blocks(RECEIVED)
            own = samples.setdefault(group.controller, {})
            for metric in QUALITIES:
                for block, value in group.blocks(metric).items():
                    if rates.get(block, 0) > 0 and math.isfinite(value):
                        own.setdefault(block, {RECEIVED: rates[block]})[metric] = value
        series: dict[object, dict[Controller, dict[Block, Sample]]] = {}
        for each in sort_controllers(controller for controller, own in samples.items() if own):
            key = (replace(each, profile=None, representation=None),) if each.is_fixed else each
            series.setdefault(key, {})[each] = samples[each]
        found = sorted(map(Series, series.values()), key=lambda one: not one.is_curve)
        return cls(network, rtt_ms, found) if found else None

    @property
    def title(self) -> str:
        rtt = "" if self.rtt_ms is None else f", {self.rtt_ms:g} ms round trip"
        return "All networks" if self.network == ALL else f"{self.network}{rtt}"

    @property
    def equal_rates(self) -> list[EqualRate]:
        """Each curve against all later series: curves first, then adaptive controllers."""
        curves = [(place, one) for place, one in enumerate(self.series, 1) if one.is_curve]
        return [EqualRate.from_series(curve, other) for place, curve in curves for other in self.series[place:]]


def by_condition(groups: Groups) -> list[RateDistortion]:
    found = (RateDistortion.from_groups(groups.at(network, rtt), network, rtt) for network, rtt in groups.conditions)
    return [one for one in found if one is not None]


def over_all(groups: Groups) -> RateDistortion | None:
    """Controllers that all networks share, each at its lowest round trip. None with fewer than two networks."""
    networks = Counter(group.controller for group in groups.lowest)
    everywhere = [group for group in groups.lowest if networks[group.controller] == len(groups.networks)]
    return RateDistortion.from_groups(everywhere, ALL, None) if len(groups.networks) > 1 else None


def _range(low: float, high: float) -> str:
    return "–".join(dict.fromkeys((RECEIVED.text(low), RECEIVED.text(high))))


def _mean_over(low: float, high: float, one: Points, two: Points) -> float:
    """Mean quality difference `two - one` over the logarithm of the rate, from low to high.

    Bjøntegaard's delta (VCEG-M33) with linear interpolation, as there are few points.
    """
    at = np.log(np.unique([low, high, *(rate for rate, _ in (*one, *two) if low < rate < high)]))
    (one_rates, one_values), (two_rates, two_values) = zip(*one, strict=True), zip(*two, strict=True)
    gaps = np.interp(at, np.log(two_rates), two_values) - np.interp(at, np.log(one_rates), one_values)
    return float(gaps[0] if len(at) == 1 else np.trapezoid(gaps, at) / (at[-1] - at[0]))
