"""Quality against rate: curves through fixed rungs, and what others differ from them by at equal rates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tigas_common.wire.run import MODE_NAMES
from tigas_experiments.report.blocks import Block, Estimate
from tigas_experiments.report.controllers import Controller, in_order
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.metrics import PICTURE_PSNR, PICTURE_SSIM, RECEIVED, SEEN_PSNR, SEEN_SSIM, Metric

QUALITIES = (SEEN_SSIM, SEEN_PSNR, PICTURE_SSIM, PICTURE_PSNR)

Sample = Mapping[Metric, float]
"""A block's rate (RECEIVED, above 0) and its qualities."""
Points = list[tuple[float, float]]
"""Rate (Mbit/s) and quality, from the lowest rate on."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """What is drawn as one: a controller that adapts, or all fixed rungs of a mode: a curve if there are several."""

    controllers: tuple[Controller, ...]
    samples: Mapping[Controller, Mapping[Block, Sample]]

    @property
    def is_curve(self) -> bool:
        """Whether quality is known at more than one rate that nothing chose."""
        return len(self.controllers) > 1

    @property
    def title(self) -> str:
        """For people."""
        first = self.controllers[0]
        if not self.is_curve:
            return first.title
        name = "Fixed rungs" if first.mode == "stateless" else f"{MODE_NAMES[first.mode].replace(',', '')}, fixed"
        return " + ".join((name, *(word.replace("-", " ") for word in first.motion)))

    def mean(self, controller: Controller, metric: Metric) -> Estimate | None:
        """Over the blocks of one controller that have the metric."""
        samples = self.samples[controller].values()
        return Estimate.over([sample[metric] for sample in samples if metric in sample])

    def points(self, block: Block, metric: Metric) -> Points:
        """In one block; a curve that has fewer than two there has none."""
        found = sorted(
            (sample[RECEIVED], sample[metric])
            for controller in self.controllers
            if (sample := self.samples[controller].get(block)) is not None and metric in sample
        )
        return found if len(found) > 1 or not self.is_curve else []

    @property
    def blocks(self) -> list[Block]:
        """Of all its controllers."""
        return list(dict.fromkeys(block for samples in self.samples.values() for block in samples))

    @property
    def rates(self) -> tuple[float, float]:
        """Mbit/s, the mean of its lowest controller and of its highest."""
        means = [estimate.mean for each in self.controllers if (estimate := self.mean(each, RECEIVED))]
        return min(means), max(means)


@dataclass(frozen=True, slots=True, eq=False)
class EqualRate:
    """A series against a curve, where both have the same rate."""

    curve: Series
    other: Series
    blocks: int
    """That both have a quality in."""
    overlapping: int
    """Of these, those in which their rates overlap."""
    rates: tuple[float, float] | None
    """Mbit/s, from the least to the greatest rate that was compared at; None if rates overlap in no block."""
    differences: Mapping[Metric, Estimate]
    """Of the other less the curve, over the blocks in which rates overlap."""

    @property
    def apart(self) -> str:
        """Why there is no difference."""
        ranges = [
            f"{series.title} {'–'.join(dict.fromkeys(map(RECEIVED.text, series.rates)))}"
            for series in (self.curve, self.other)
        ]
        return f"no overlap: {', '.join(ranges)} Mbit/s"


@dataclass(frozen=True, slots=True, eq=False)
class RateDistortion:
    """All that was measured over one network and round trip, or over several networks."""

    network: str | None
    """None: over all."""
    rtt_ms: float | None
    series: tuple[Series, ...]

    @classmethod
    def of(cls, groups: Sequence[Group], network: str | None, rtt_ms: float | None) -> RateDistortion | None:
        """Of groups that differ in their controllers and perhaps networks. None if no quality was measured."""
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
        """Each curve against all series that come after it: curves first, then what adapts."""
        return [
            _equal_rate(curve, other)
            for place, curve in enumerate(self.series)
            if curve.is_curve
            for other in self.series[place + 1 :]
        ]


def by_condition(groups: Groups) -> list[RateDistortion]:
    """Of each network at each round trip."""
    conditions = dict.fromkeys((group.condition.network, group.condition.rtt_ms) for group in groups)
    found = (RateDistortion.of(groups.at(network, rtt), network, rtt) for network, rtt in conditions)
    return [one for one in found if one is not None]


def over_all(groups: Groups) -> RateDistortion | None:
    """Of the controllers that all networks have, each at its lowest round trip. None with fewer than two networks."""
    networks = groups.networks
    own = [group for network in networks for group in groups.at(network, groups.base_rtt(network))]
    counts = {controller: sum(group.controller == controller for group in own) for controller in groups.looks}
    everywhere = [group for group in own if counts[group.controller] == len(networks)]
    return RateDistortion.of(everywhere, None, None) if len(networks) > 1 else None


def _samples(group: Group) -> dict[Block, Sample]:
    """Of the blocks that have a rate and a quality."""
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
        differences={metric: found for metric in QUALITIES if (found := Estimate.over(values[metric]))},
    )


def _mean_over(low: float, high: float, one: Points, two: Points) -> float:
    """The other's quality less the curve's, mean over the logarithm of the rate, from low to high.

    As Bjøntegaard's delta (VCEG-M33), but with straight lines between the points, of which there are few.
    """
    within = [rate for rate, _ in (*one, *two) if low < rate < high]
    rates = np.log(np.unique([low, *within, high]))
    gaps = _interpolated(two)(rates) - _interpolated(one)(rates)
    if len(rates) == 1:
        return float(gaps[0])
    return float(np.sum((gaps[1:] + gaps[:-1]) / 2 * np.diff(rates)) / (rates[-1] - rates[0]))


def _interpolated(points: Iterable[tuple[float, float]]) -> Callable[[np.ndarray], np.ndarray]:
    rates, qualities = zip(*points, strict=True)
    return lambda at: np.interp(at, np.log(rates), qualities)
