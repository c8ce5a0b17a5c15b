"""Groups of runs with equal network, round trip and controller, and their means and ranges.

Groups of one network and round trip cover the same blocks: a controller without runs of the hard blocks would look
better than it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from tigas_experiments.records.folder import RunRecord
from tigas_experiments.report.controllers import Controller, Look, in_order, looks
from tigas_experiments.report.estimates import Estimate
from tigas_experiments.report.metrics import Metric, Value
from tigas_experiments.report.results import Floats, Run
from tigas_experiments.wire.run import Configuration


@dataclass(frozen=True, slots=True)
class Block:
    """Inputs of a run apart from its controller: part of a network trace × part of a movement × scene.

    Repeats share a block: they measure how much a run varies, not how inputs differ.
    """

    network: str
    """Name without the round trip."""
    trace_offset_s: float
    scene: str
    movement: str
    movement_offset_s: float

    @classmethod
    def of(cls, configuration: Configuration) -> Self:
        """The block of a run."""
        network = configuration.network
        return cls(
            network.name,
            network.offset_s,
            configuration.scene,
            Path(configuration.movement).name,
            configuration.movement_offset_s,
        )


@dataclass(frozen=True, slots=True)
class Condition:
    """Conditions of a run apart from its scene, movement and repeat."""

    network: str
    """Name without the round trip."""
    rtt_ms: float | None
    """None if it varies with the trace or is unknown."""
    controller: Controller

    @classmethod
    def of(cls, record: RunRecord) -> Condition:
        """The condition of a run."""
        network = record.configuration.network
        return cls(network.name, network.round_trip_ms, Controller.of(record.configuration))


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and range of a metric over several runs."""

    mean: float
    low: float
    high: float
    runs: int
    """Number of runs that have the metric."""

    @classmethod
    def over(cls, values: Sequence[Value], means: Iterable[float] = ()) -> Spread | None:
        """Spread of the known values; None without any. One infinite value makes the mean infinite.

        `means` are the means of blocks, which are weighted equally.
        """
        found = [value for value in values if value is not None]
        if not found:
            return None
        low, high = min(found), max(found)
        counted = list(means) or found
        # Rounding must not move the mean of equal values outside their range.
        return cls(min(max(sum(counted) / len(counted), low), high), low, high, len(found))


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """All runs of one condition."""

    condition: Condition
    runs: tuple[Run, ...]

    @property
    def controller(self) -> Controller:
        """The controller or stream under comparison."""
        return self.condition.controller

    @property
    def saturated(self) -> bool:
        """Whether the machine was the bottleneck in any run."""
        return any(run.saturated for run in self.runs)

    def spread(self, metric: Metric) -> Spread | None:
        """Mean over blocks, and range over runs."""
        return Spread.over([run.values[metric.name] for run in self.runs], self.blocks(metric).values())

    def estimate(self, metric: Metric) -> Estimate | None:
        """Mean over blocks with its interval; None if no run has the metric."""
        return Estimate.over(list(self.blocks(metric).values()))

    def blocks(self, metric: Metric) -> dict[Block, float]:
        """Mean over repeats in each block that has the metric."""
        values: dict[Block, list[float]] = {}
        for run in self.runs:
            if (value := run.values[metric.name]) is not None:
                values.setdefault(Block.of(run.record.configuration), []).append(value)
        return {block: sum(found) / len(found) for block, found in values.items()}

    @property
    def all_blocks(self) -> set[Block]:
        """Blocks covered by the runs."""
        return {Block.of(run.record.configuration) for run in self.runs}

    @property
    def latencies(self) -> Floats:
        """[inputs] Motion-to-photon latencies of all runs, ms; inf for unanswered inputs."""
        return np.concatenate([run.latencies[:, 1] for run in self.runs])

    @property
    def frame_ages(self) -> Floats:
        """[frames] Frame ages of all runs, ms."""
        return np.concatenate([run.frame_ages[:, 1] for run in self.runs])


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All runs over one network at one round trip."""

    runs: Mapping[Condition, tuple[Run, ...]]

    @property
    def blocks(self) -> dict[Condition, set[Block]]:
        """Blocks covered by each controller."""
        return {
            condition: {Block.of(run.record.configuration) for run in runs} for condition, runs in self.runs.items()
        }

    @property
    def common(self) -> set[Block]:
        """Blocks covered by all controllers."""
        return set.intersection(*self.blocks.values())

    @property
    def missing(self) -> dict[Controller, int]:
        """Number of blocks that each controller lacks, if any."""
        blocks = self.blocks
        every = set.union(*blocks.values())
        return {condition.controller: len(every - own) for condition, own in blocks.items() if len(own) < len(every)}

    @property
    def common_runs(self) -> Mapping[Condition, tuple[Run, ...]]:
        """Runs of the common blocks; all runs without common blocks."""
        common = self.common
        if not common:
            return self.runs
        return {
            condition: tuple(run for run in runs if Block.of(run.record.configuration) in common)
            for condition, runs in self.runs.items()
        }


def comparisons(runs: Iterable[Run]) -> list[Comparison]:
    """One comparison for each network and round trip."""
    found: dict[tuple[str, float | None], dict[Condition, tuple[Run, ...]]] = {}
    for run in runs:
        condition = Condition.of(run.record)
        own = found.setdefault((condition.network, condition.rtt_ms), {})
        own[condition] = (*own.get(condition, ()), run)
    return [Comparison(own) for own in found.values()]


class Groups(tuple[Group, ...]):
    """All groups of an experiment, sorted by network, round trip and controller."""

    __slots__ = ()

    @classmethod
    def of(cls, runs: Iterable[Run]) -> Groups:
        """Groups of the runs in common blocks, or of all runs without common blocks."""
        by_condition = {
            condition: common for compared in comparisons(runs) for condition, common in compared.common_runs.items()
        }
        order = in_order(condition.controller for condition in by_condition)

        def place(condition: Condition) -> tuple[str, float, int]:
            return condition.network, rtt_order(condition.rtt_ms), order.index(condition.controller)

        return cls(Group(condition, by_condition[condition]) for condition in sorted(by_condition, key=place))

    @property
    def networks(self) -> list[str]:
        """Names of the networks."""
        return list(dict.fromkeys(group.condition.network for group in self))

    @property
    def conditions(self) -> list[tuple[str, float | None]]:
        """Each network with each of its round trips."""
        return list(dict.fromkeys((group.condition.network, group.condition.rtt_ms) for group in self))

    @property
    def looks(self) -> dict[Controller, Look]:
        """Line style of each controller, in the order of all tables and legends."""
        return looks(group.controller for group in self)

    def rtts(self, network: str) -> list[float]:
        """Known round trips of a network, ascending."""
        return sorted(rtt for name, rtt in self.conditions if name == network and rtt is not None)

    def at(self, network: str, rtt_ms: float | None) -> list[Group]:
        """Groups of one network and round trip."""
        return [g for g in self if (g.condition.network, g.condition.rtt_ms) == (network, rtt_ms)]

    def base_rtt(self, network: str) -> float | None:
        """The lowest round trip, which figures with only one round trip show."""
        return next(iter(self.rtts(network)), None)

    def base(self, network: str) -> list[Group]:
        """Groups of a network at its lowest round trip."""
        return self.at(network, self.base_rtt(network))


@dataclass(frozen=True, slots=True, eq=False)
class Overall:
    """One controller at one round trip, over all networks."""

    rtt_ms: float | None
    controller: Controller
    groups: tuple[Group, ...]
    """One for each network."""

    @property
    def runs(self) -> int:
        """Number of runs over all networks."""
        return sum(len(group.runs) for group in self.groups)

    @property
    def name(self) -> str:
        """The controller's title, marked with * if the machine was the bottleneck in any run."""
        return self.controller.title + "*" * any(group.saturated for group in self.groups)

    def spread(self, metric: Metric) -> Spread | None:
        """Spread of the networks' means, which are weighted equally."""
        spreads = [group.spread(metric) for group in self.groups]
        return Spread.over([None if spread is None else spread.mean for spread in spreads])


def overall(groups: Groups) -> list[Overall]:
    """Controllers at the round trips that all networks share, by round trip and controller."""
    networks = groups.networks
    found = []
    for rtt in sorted({rtt for _, rtt in groups.conditions}, key=rtt_order):
        for controller in groups.looks:
            own = tuple(g for g in groups if (g.condition.rtt_ms, g.controller) == (rtt, controller))
            if len(own) == len(networks):
                found.append(Overall(rtt, controller, own))
    return found


def rtt_order(rtt_ms: float | None) -> float:
    """Sort key of a round trip: unknown ones first."""
    return -1.0 if rtt_ms is None else rtt_ms
