"""Quality against rate: curves through fixed rungs, and differences from them at equal rates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tigas_experiments.report.controllers import Controller, in_order
from tigas_experiments.report.estimates import Estimate
from tigas_experiments.report.groups import Block, Group, Groups
from tigas_experiments.report.metrics import METRICS, Metric, chosen
from tigas_experiments.wire.run import MODE_NAMES

RECEIVED = METRICS["received_mbit_s"]
QUALITIES = chosen("seen_ssim", "seen_psnr_db", "picture_ssim", "picture_psnr_db")

Sample = Mapping[Metric, float]
"""Rate (RECEIVED, above 0) and qualities of a block."""
Points = list[tuple[float, float]]
"""Rate (Mbit/s) and quality, by ascending rate."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """An adaptive controller, or all fixed rungs of a mode, which form a curve if there are several."""

    controllers: tuple[Controller, ...]
    samples: Mapping[Controller, Mapping[Block, Sample]]

    @property
    def is_curve(self) -> bool:
        """Whether quality is known at several fixed rates."""
        return len(self.controllers) > 1

    @property
    def title(self) -> str:
        """Display name."""
        first = self.controllers[0]
        if not self.is_curve:
            return first.title
        name = "Fixed rungs" if first.mode == "stateless" else f"{MODE_NAMES[first.mode].replace(',', '')}, fixed"
        return " + ".join((name, *(word.replace("-", " ") for word in first.motion)))

    def mean(self, controller: Controller, metric: Metric) -> Estimate | None:
        """Mean over the blocks of one controller that have the metric."""
        samples = self.samples[controller].values()
        return Estimate.over([sample[metric] for sample in samples if metric in sample])

    def points(self, block: Block, metric: Metric) -> Points:
        """Points of one block; none for a curve with fewer than two."""
        found = sorted(
            (sample[RECEIVED], sample[metric])
            for controller in self.controllers
            if (sample := self.samples[controller].get(block)) is not None and metric in sample
        )
        return found if len(found) > 1 or not self.is_curve else []

    @property
    def blocks(self) -> list[Block]:
        """Blocks of all controllers."""
        return list(dict.fromkeys(block for samples in self.samples.values() for block in samples))

    @property
    def rates(self) -> tuple[float, float]:
        """Mean rates of the lowest and the highest controller, Mbit/s."""
        means = [estimate.mean for each in self.controllers if (estimate := self.mean(each, RECEIVED))]
        return min(means), max(means)


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
    differences: Mapping[Metric, Estimate]
    """Quality of the series minus that of the curve, over the overlapping blocks."""

    @property
    def rates_text(self) -> str | None:
        """The formatted rates without their unit; None if rates overlap in no block."""
        return None if self.rates is None else _range(self.rates)

    @property
    def no_overlap(self) -> str:
        """Explanation of a missing difference."""
        ranges = [f"{series.title} {_range(series.rates)}" for series in (self.curve, self.other)]
        return f"no overlap: {', '.join(ranges)} Mbit/s"


@dataclass(frozen=True, slots=True, eq=False)
class RateDistortion:
    """All series of one network and round trip, or of several networks."""

    network: str | None
    """None for all networks."""
    rtt_ms: float | None
    series: tuple[Series, ...]

    @classmethod
    def of(cls, groups: Sequence[Group], network: str | None, rtt_ms: float | None) -> RateDistortion | None:
        """Series of groups with different controllers and perhaps networks; None without a measured quality."""
        samples: dict[Controller, dict[Block, Sample]] = {}
        for group in groups:
            samples.setdefault(group.controller, {}).update(_samples(group))
        found = {controller: samples[controller] for controller in in_order(samples) if samples[controller]}
        if not found:
            return None
        by_series: dict[object, list[Controller]] = {}
        for controller in found:
            own = (controller.mode, controller.motion) if controller.fixed else controller
            by_series.setdefault(own, []).append(controller)
        series = (Series(tuple(own), {each: found[each] for each in own}) for own in by_series.values())
        return cls(network, rtt_ms, tuple(sorted(series, key=lambda one: not one.is_curve)))

    @property
    def equal_rates(self) -> list[EqualRate]:
        """Each curve against all later series: curves first, then adaptive controllers."""
        return [
            _equal_rate(curve, other)
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
    networks = groups.networks
    own = [group for network in networks for group in groups.base(network)]
    counts = {controller: sum(group.controller == controller for group in own) for controller in groups.looks}
    everywhere = [group for group in own if counts[group.controller] == len(networks)]
    return RateDistortion.of(everywhere, None, None) if len(networks) > 1 else None


def _range(rates: tuple[float, float]) -> str:
    return "–".join(dict.fromkeys(map(RECEIVED.text, rates)))


def _samples(group: Group) -> dict[Block, Sample]:
    """Blocks that have a rate and a quality."""
    rates = {block: rate for block, rate in group.blocks(RECEIVED).items() if rate > 0}
    found: dict[Block, dict[Metric, float]] = {}
    for metric in QUALITIES:
        for block, value in group.blocks(metric).items():
            if block in rates and math.isfinite(value):
                found.setdefault(block, {RECEIVED: rates[block]})[metric] = value
    return dict(found)


def _equal_rate(curve: Series, other: Series) -> EqualRate:
    blocks = set(curve.blocks)
    both = [block for block in other.blocks if block in blocks]
    values: dict[Metric, list[float]] = {metric: [] for metric in QUALITIES}
    ranges: dict[Block, tuple[float, float]] = {}
    compared = set()
    for block in both:
        for metric in QUALITIES:
            one, two = curve.points(block, metric), other.points(block, metric)
            if not one or not two:
                continue
            compared.add(block)
            low, high = max(one[0][0], two[0][0]), min(one[-1][0], two[-1][0])
            if low <= high:
                ranges[block] = (low, high)
                values[metric].append(_mean_over(low, high, one, two))
    return EqualRate(
        curve=curve,
        other=other,
        blocks=len(compared),
        overlapping=len(ranges),
        rates=(min(low for low, _ in ranges.values()), max(high for _, high in ranges.values())) if ranges else None,
        differences={metric: found for metric in QUALITIES if (found := Estimate.over(values[metric], metric.step))},
    )


def _mean_over(low: float, high: float, one: Points, two: Points) -> float:
    """Mean quality difference `two - one` over the logarithm of the rate, from low to high.

    Bjøntegaard's delta (VCEG-M33) with linear interpolation, because there are few points.
    """
    within = [rate for rate, _ in (*one, *two) if low < rate < high]
    rates = np.log(np.unique([low, *within, high]))
    gaps = _interpolated(two)(rates) - _interpolated(one)(rates)
    if len(rates) == 1:
        return float(gaps[0])
    return float(np.trapezoid(gaps, rates) / (rates[-1] - rates[0]))


def _interpolated(points: Iterable[tuple[float, float]]) -> Callable[[np.ndarray], np.ndarray]:
    rates, qualities = zip(*points, strict=True)
    return lambda at: np.interp(at, np.log(rates), qualities)
