"""Quality against rate: curves through fixed rungs, and differences from them at equal rates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tigas_experiments.report.controllers import Controller, in_order
from tigas_experiments.report.estimates import Estimate
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.metrics import METRICS, Metric, chosen
from tigas_experiments.report.run_table import Block
from tigas_experiments.wire.run import MODE_NAMES

RECEIVED = METRICS["received_mbit_s"]
QUALITIES = chosen("seen_ssim", "seen_psnr_db", "picture_ssim", "picture_psnr_db")
Sample = dict[Metric, float]
"""Rate (RECEIVED, above 0) and qualities of a block."""
Points = list[tuple[float, float]]
"""Rate (Mbit/s) and quality, by ascending rate."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """An adaptive controller, or all fixed rungs of a mode, which form a curve if there are several."""

    samples: Mapping[Controller, Mapping[Block, Sample]]

    @property
    def controllers(self) -> list[Controller]:
        """The controllers, in the order of tables."""
        return list(self.samples)

    @property
    def is_curve(self) -> bool:
        """Whether quality is known at several fixed rates."""
        return len(self.samples) > 1

    @property
    def title(self) -> str:
        """Display name."""
        first = self.controllers[0]
        if not self.is_curve:
            return first.title
        name = "Fixed rungs" if first.mode == "stateless" else f"{MODE_NAMES[first.mode].replace(',', '')}, fixed"
        return " + ".join((name, *(word.replace("-", " ") for word in first.motion)))

    def values(self, controller: Controller, metric: Metric, having: Metric | None = None) -> list[float]:
        """Values of the blocks of a controller that have the metric, and another one."""
        samples = self.samples[controller].values()
        return [sample[metric] for sample in samples if metric in sample and (having or metric) in sample]

    def points(self, block: Block, metric: Metric) -> Points:
        """Points of one block; none for a curve with fewer than two."""
        samples = (own[block] for own in self.samples.values() if block in own)
        found = sorted((sample[RECEIVED], sample[metric]) for sample in samples if metric in sample)
        return found if len(found) > 1 or not self.is_curve else []

    @property
    def blocks(self) -> list[Block]:
        """Blocks of all controllers."""
        return list(dict.fromkeys(block for samples in self.samples.values() for block in samples))

    @property
    def rates_text(self) -> str:
        """Mean rates of the lowest and the highest controller."""
        means = [float(np.mean(self.values(each, RECEIVED))) for each in self.samples]
        return _range(min(means), max(means))


@dataclass(frozen=True, slots=True, eq=False)
class EqualRate:
    """A series against a curve at equal rates."""

    curve: Series
    other: Series
    blocks: int
    """Number of blocks in which both have a quality."""
    overlapping: int
    """Number of these blocks in which their rates overlap."""
    rates: tuple[float, float] | None
    """Lowest and highest compared rate, Mbit/s; None if rates overlap in no block."""
    differences: Mapping[Metric, Estimate | None]
    """Quality of the series minus that of the curve, over the overlapping blocks."""

    @classmethod
    def of(cls, curve: Series, other: Series) -> EqualRate:
        """Compare them block by block."""
        values: dict[Metric, list[float]] = {metric: [] for metric in QUALITIES}
        ranges: dict[Block, tuple[float, float]] = {}
        compared = set()
        for block in other.blocks:
            for metric in QUALITIES:
                one, two = curve.points(block, metric), other.points(block, metric)
                if not one or not two:
                    continue
                compared.add(block)
                low, high = max(one[0][0], two[0][0]), min(one[-1][0], two[-1][0])
                if low <= high:
                    ranges[block] = (low, high)
                    values[metric].append(_mean_over(low, high, one, two))
        ends = [*zip(*ranges.values(), strict=True)]
        return cls(
            curve=curve,
            other=other,
            blocks=len(compared),
            overlapping=len(ranges),
            rates=(min(ends[0]), max(ends[1])) if ends else None,
            differences={metric: Estimate.over(values[metric], metric.step) for metric in QUALITIES},
        )

    def estimate(self, metric: Metric) -> Estimate | None:
        """Difference of a quality."""
        return self.differences[metric]

    @property
    def labels(self) -> list[str]:
        """First cells of its row: titles, and the rates and blocks unless there is no overlap."""
        titles = [self.curve.title, self.other.title]
        return titles if self.rates is None else [*titles, _range(*self.rates), f"{self.overlapping} of {self.blocks}"]

    @property
    def no_overlap(self) -> str:
        """Explanation of a missing difference; empty unless it is missing."""
        ranges = [f"{series.title} {series.rates_text}" for series in (self.curve, self.other)]
        return "" if self.rates else f"no overlap: {', '.join(ranges)} Mbit/s"


@dataclass(frozen=True, slots=True, eq=False)
class RateDistortion:
    """All series of one network and round trip, or of several networks."""

    network: str | None
    """None for all networks."""
    rtt_ms: float | None
    series: tuple[Series, ...]
    """Curves first."""

    @classmethod
    def of(cls, groups: Sequence[Group], network: str | None, rtt_ms: float | None) -> RateDistortion | None:
        """Series of groups with different controllers and perhaps networks; None without a measured quality."""
        samples: dict[Controller, dict[Block, Sample]] = {}
        for group in groups:
            rates = group.blocks(RECEIVED)
            own = samples.setdefault(group.controller, {})
            for metric in QUALITIES:
                for block, value in group.blocks(metric).items():
                    if rates.get(block, 0) > 0 and math.isfinite(value):
                        own.setdefault(block, {RECEIVED: rates[block]})[metric] = value
        series: dict[object, dict[Controller, dict[Block, Sample]]] = {}
        for each in in_order(controller for controller, own in samples.items() if own):
            key = (each.mode, each.motion) if each.fixed else each
            series.setdefault(key, {})[each] = samples[each]
        found = sorted(map(Series, series.values()), key=lambda one: not one.is_curve)
        return cls(network, rtt_ms, tuple(found)) if found else None

    @property
    def title(self) -> str:
        """Caption of its table."""
        rtt = "" if self.rtt_ms is None else f", {self.rtt_ms:g} ms round trip"
        return "All networks" if self.network is None else f"{self.network}{rtt}"

    @property
    def equal_rates(self) -> list[EqualRate]:
        """Each curve against all later series: curves first, then adaptive controllers."""
        return [
            EqualRate.of(curve, other)
            for place, curve in enumerate(self.series)
            if curve.is_curve
            for other in self.series[place + 1 :]
        ]


def by_condition(groups: Groups) -> list[RateDistortion]:
    """Series of each network at each round trip."""
    found = (RateDistortion.of(groups.at(network, rtt), network, rtt) for network, rtt in groups.conditions)
    return [one for one in found if one is not None]


def over_all(groups: Groups) -> RateDistortion | None:
    """Controllers that all networks share, each at its lowest round trip. None with fewer than two networks."""
    own = [group for network in groups.networks for group in groups.base(network)]
    everywhere = [
        group for group in own if sum(each.controller == group.controller for each in own) == len(groups.networks)
    ]
    return RateDistortion.of(everywhere, None, None) if len(groups.networks) > 1 else None


def _range(low: float, high: float) -> str:
    return "–".join(dict.fromkeys((RECEIVED.text(low), RECEIVED.text(high))))


def _mean_over(low: float, high: float, one: Points, two: Points) -> float:
    """Mean quality difference `two - one` over the logarithm of the rate, from low to high.

    Bjøntegaard's delta (VCEG-M33) with linear interpolation, because there are few points.
    """
    at = np.log(np.unique([low, high, *(rate for rate, _ in (*one, *two) if low < rate < high)]))
    (one_rates, one_values), (two_rates, two_values) = zip(*one, strict=True), zip(*two, strict=True)
    gaps = np.interp(at, np.log(two_rates), two_values) - np.interp(at, np.log(one_rates), one_values)
    return float(gaps[0] if len(at) == 1 else np.trapezoid(gaps, at) / (at[-1] - at[0]))
