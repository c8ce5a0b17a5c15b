"""Aggregates runs: those of equal network, round trip and controller are a group, with one spread for each metric."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tigas_experiments.records.folder import RunRecord
from tigas_experiments.report.blocks import Block, Estimate
from tigas_experiments.report.controllers import Controller, Look, in_order, looks
from tigas_experiments.report.metrics import Metric, Value
from tigas_experiments.report.results import Floats, Run


@dataclass(frozen=True, slots=True)
class Condition:
    """What a run was made under, but for its scene, movement and repeat."""

    network: str
    """Without its round trip."""
    rtt_ms: float | None
    """None: the trace's own, or unknown."""
    controller: Controller

    @classmethod
    def of(cls, record: RunRecord) -> Condition:
        """Of a run."""
        network = record.configuration.network
        return cls(network.name, network.round_trip_ms, Controller.of(record.configuration))


@dataclass(frozen=True, slots=True)
class Spread:
    """A metric over several runs."""

    mean: float
    low: float
    high: float
    runs: int
    """That have the metric."""

    @classmethod
    def over(cls, values: Sequence[Value], means: Iterable[float] = ()) -> Spread | None:
        """Without the runs that do not have it; None if none has. inf in one makes the mean inf.

        `means` are those of the blocks that the runs are of, each of which counts the same.
        """
        found = [value for value in values if value is not None]
        if not found:
            return None
        low, high = min(found), max(found)
        counted = list(means) or found
        # Rounding must not carry the mean of equal values beyond them.
        return cls(min(max(sum(counted) / len(counted), low), high), low, high, len(found))


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """All runs of one condition."""

    condition: Condition
    runs: tuple[Run, ...]

    @property
    def controller(self) -> Controller:
        """What was compared."""
        return self.condition.controller

    @property
    def saturated(self) -> bool:
        """Whether the machine was the bottleneck in a run."""
        return any(run.saturated for run in self.runs)

    def spread(self, metric: Metric) -> Spread | None:
        """Of one metric: the mean over blocks, the least and the greatest run."""
        return Spread.over([metric.of(run.record, run.figures) for run in self.runs], self.blocks(metric).values())

    def estimate(self, metric: Metric) -> Estimate | None:
        """The mean over blocks with its interval; None if no run has the metric."""
        return Estimate.over(list(self.blocks(metric).values()))

    def blocks(self, metric: Metric) -> dict[Block, float]:
        """The mean over the repeats of each block that have the metric."""
        values: dict[Block, list[float]] = {}
        for run in self.runs:
            value = metric.of(run.record, run.figures)
            if value is not None:
                values.setdefault(Block.of(run.record.configuration), []).append(value)
        return {block: sum(found) / len(found) for block, found in values.items()}

    @property
    def every_block(self) -> set[Block]:
        """That the runs are of."""
        return {Block.of(run.record.configuration) for run in self.runs}

    def has(self, metric: Metric) -> bool:
        """Whether all runs have the metric."""
        return all(metric.of(run.record, run.figures) is not None for run in self.runs)

    @property
    def latencies(self) -> Floats:
        """[inputs] Motion-to-photon of all runs together, ms; inf where no frame came."""
        return np.concatenate([run.latencies[:, 1] for run in self.runs])

    @property
    def frame_ages(self) -> Floats:
        """[frames] Of all runs together, ms."""
        return np.concatenate([run.frame_ages[:, 1] for run in self.runs])


class Groups(tuple[Group, ...]):
    """All groups of an experiment, by network, round trip and controller."""

    __slots__ = ()

    @classmethod
    def of(cls, runs: Iterable[Run]) -> Groups:
        """Of all runs."""
        by_condition: dict[Condition, list[Run]] = {}
        for run in runs:
            by_condition.setdefault(Condition.of(run.record), []).append(run)
        order = in_order(condition.controller for condition in by_condition)

        def place(condition: Condition) -> tuple[str, float, int]:
            rtt = -1.0 if condition.rtt_ms is None else condition.rtt_ms
            return condition.network, rtt, order.index(condition.controller)

        return cls(Group(condition, tuple(by_condition[condition])) for condition in sorted(by_condition, key=place))

    @property
    def networks(self) -> list[str]:
        """By name."""
        return list(dict.fromkeys(group.condition.network for group in self))

    @property
    def looks(self) -> dict[Controller, Look]:
        """Each controller's, in the order of every table and legend."""
        return looks(group.controller for group in self)

    def rtts(self, network: str) -> list[float]:
        """The round trips that are known, from the lowest."""
        found = {group.condition.rtt_ms for group in self if group.condition.network == network}
        return sorted(rtt for rtt in found if rtt is not None)

    def at(self, network: str, rtt_ms: float | None) -> list[Group]:
        """Those of one network and round trip."""
        return [g for g in self if (g.condition.network, g.condition.rtt_ms) == (network, rtt_ms)]

    def base_rtt(self, network: str) -> float | None:
        """The round trip that stands for the network where only one is shown: the lowest."""
        return next(iter(self.rtts(network)), None)


@dataclass(frozen=True, slots=True, eq=False)
class Overall:
    """One controller at one round trip."""

    rtt_ms: float | None
    controller: Controller
    groups: tuple[Group, ...]
    """One a network."""

    @property
    def runs(self) -> int:
        """Of all networks."""
        return sum(len(group.runs) for group in self.groups)

    @property
    def name(self) -> str:
        """The controller's, marked if the machine was the bottleneck in a run."""
        return self.controller.title + "*" * any(group.saturated for group in self.groups)

    def spread(self, metric: Metric) -> Spread | None:
        """Of the networks' means, each of which counts the same."""
        spreads = [group.spread(metric) for group in self.groups]
        return Spread.over([None if spread is None else spread.mean for spread in spreads])


def overall(groups: Groups) -> list[Overall]:
    """By round trip and controller; of round trips that all networks have, so that their metrics can be compared."""
    networks = groups.networks
    found = []
    for rtt in sorted({group.condition.rtt_ms for group in groups}, key=lambda rtt: -1.0 if rtt is None else rtt):
        at = [group for group in groups if group.condition.rtt_ms == rtt]
        for controller in groups.looks:
            its = tuple(group for group in at if group.controller == controller)
            if len(its) == len(networks):
                found.append(Overall(rtt, controller, its))
    return found
