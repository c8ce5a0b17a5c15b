"""Groups of runs with the same network, round trip and controller, with their means and differences from a baseline.

All groups of one network and round trip cover the same blocks: a controller without runs of the hard blocks would look
better than it is.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from tigas_common.errors import StartError
from tigas_experiments.records.folder import ExperimentRecord
from tigas_experiments.report.controllers import Controller, LineLook, assign_looks, sort_controllers
from tigas_experiments.report.estimates import Estimate, differences
from tigas_experiments.report.metrics import Metric
from tigas_experiments.report.run_table import Block, Condition, Floats, Run

ALL = "all"
"""Stands for all networks in place of a network's name."""
AnyRow = TypeVar("AnyRow", "Group", "Difference")


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """All runs of one condition, or of a controller at one round trip over all networks."""

    condition: Condition
    runs: Sequence[Run]
    networks: Sequence[Group] = ()
    """Groups of the single networks that it combines."""

    @property
    def controller(self) -> Controller:
        return self.condition.controller

    @property
    def labels(self) -> list[str]:
        """First cells of its row; a controller is marked with * if the machine was the bottleneck in any run."""
        title = self.controller.title + "*" * any(run.saturated for run in self.runs)
        return [*self.condition.labels, title, str(len(self.runs))]

    def estimate(self, metric: Metric) -> Estimate | None:
        """Mean over blocks with its interval, and range over runs; None if no run has the metric.

        Over all networks: mean and range of the networks' means, weighted equally; None if any network has no value.
        """
        if self.networks:
            found = [each.estimate(metric) for each in self.networks]
            known = [each.mean for each in found if each is not None]
            return Estimate.from_means(known) if len(known) == len(found) else None
        values = [value for run in self.runs if (value := run.values[metric.name]) is not None]
        return Estimate.from_blocks(self.blocks(metric), runs=values)

    def blocks(self, metric: Metric) -> dict[Block, float]:
        values: dict[Block, list[float]] = {}
        for run in self.runs:
            if (value := run.values[metric.name]) is not None:
                values.setdefault(run.block, []).append(value)
        return {block: sum(found) / len(found) for block, found in values.items()}

    @property
    def all_blocks(self) -> set[Block]:
        return {run.block for run in self.runs}

    def pooled(self, series: str) -> Floats:
        """Values of a time series of all runs, such as `latency`."""
        return np.concatenate([run.series[series][:, 1] for run in self.runs])


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """A controller against the baseline at one round trip, over one network or all of them."""

    condition: Condition
    pairs: Sequence[tuple[Group, Group]]
    """Groups of the controller and the baseline, one pair per network."""

    @property
    def baseline(self) -> Controller:
        return self.pairs[0][1].controller

    @property
    def labels(self) -> list[str]:
        """First cells of its row, with the number of common blocks."""
        blocks = sum(len(own.all_blocks & base.all_blocks) for own, base in self.pairs)
        return [*self.condition.labels, self.condition.controller.title, str(blocks)]

    def estimate(self, metric: Metric) -> Estimate | None:
        """Mean difference over all common blocks; None without common blocks."""
        pairs = [differences(own.blocks(metric), base.blocks(metric)) for own, base in self.pairs]
        return Estimate.from_blocks({block: value for found in pairs for block, value in found.items()}, metric.step)


class Comparison(NamedTuple):
    runs: Mapping[Condition, Sequence[Run]]
    common: set[Block]
    """Blocks covered by all controllers."""
    missing: Counter[Controller]
    """Number of blocks that each controller lacks, if any."""
    kept: Mapping[Condition, Sequence[Run]]
    """Runs of the common blocks; all runs if there are no common blocks."""


def comparisons(runs: Iterable[Run]) -> list[Comparison]:
    conditions: dict[tuple[str, float | None], dict[Condition, list[Run]]] = {}
    for run in runs:
        condition = Condition.from_record(run.record)
        conditions.setdefault(condition[:2], {}).setdefault(condition, []).append(run)
    found = []
    for own in conditions.values():
        blocks = {condition: {run.block for run in runs} for condition, runs in own.items()}
        common, every = set.intersection(*blocks.values()), set.union(*blocks.values())
        missing = Counter({condition.controller: len(every - covered) for condition, covered in blocks.items()})
        kept = {condition: [run for run in runs if run.block in (common or every)] for condition, runs in own.items()}
        found.append(Comparison(own, common, +missing, kept))
    return found


class Groups(tuple[Group, ...]):
    """All groups of an experiment, sorted by network, round trip and controller."""

    __slots__ = ()

    @classmethod
    def from_runs(cls, runs: Iterable[Run]) -> Groups:
        found = [Group(condition, kept) for compared in comparisons(runs) for condition, kept in compared.kept.items()]
        order = sort_controllers(group.controller for group in found)

        def place(group: Group) -> tuple[str, float, int]:
            return group.condition.network, _rtt_order(group.condition), order.index(group.controller)

        return cls(sorted(found, key=place))

    @property
    def networks(self) -> list[str]:
        return list(dict.fromkeys(group.condition.network for group in self))

    @property
    def conditions(self) -> list[tuple[str, float | None]]:
        return list(dict.fromkeys(group.condition[:2] for group in self))

    @property
    def looks(self) -> dict[Controller, LineLook]:
        """Line style of each controller, in the order used in all tables and legends."""
        return assign_looks(group.controller for group in self)

    def rtts(self, network: str) -> list[float]:
        """Known round trips of a network, ascending."""
        return sorted(rtt for name, rtt in self.conditions if name == network and rtt is not None)

    def at(self, network: str, rtt_ms: float | None) -> list[Group]:
        """Groups of one network and round trip."""
        return [group for group in self if group.condition[:2] == (network, rtt_ms)]

    def base_rtt(self, network: str) -> float | None:
        """The lowest round trip, used in figures that show only one."""
        return next(iter(self.rtts(network)), None)

    def base(self, network: str) -> list[Group]:
        """Groups of a network at its lowest round trip."""
        return self.at(network, self.base_rtt(network))

    def base_title(self, network: str) -> str:
        """A network and its lowest round trip, in a caption."""
        rtt = self.base_rtt(network)
        return network if rtt is None else f"{network} at {rtt:g} ms round trip"

    @property
    def lowest(self) -> list[Group]:
        """Groups of each network at its lowest round trip."""
        return [group for network in self.networks for group in self.base(network)]

    @property
    def lowest_title(self) -> str:
        """Round trips of a figure over all networks, for a caption."""
        found = sorted({rtt for name in self.networks if (rtt := self.base_rtt(name)) is not None})
        return f"at its lowest round trip ({', '.join(f'{rtt:g}' for rtt in found)} ms)" if found else "unchanged"

    def overall(self) -> list[Group]:
        """Means over all networks of the controllers that all networks have at one round trip."""
        return [
            Group(condition, [run for group in own for run in group.runs], own)
            for condition, own in self._common_to_networks(self)
        ]

    def against(self, baseline: Controller) -> list[Difference]:
        """Differences from the baseline over all networks at their common round trips, then over each network."""
        bases = {group.condition[:2]: group for group in self if group.controller == baseline}
        each = [
            Difference(group.condition, [(group, bases[group.condition[:2]])])
            for group in self
            if group.condition[:2] in bases and group.controller != baseline
        ]
        over_all = [
            Difference(condition, [pair for one in own for pair in one.pairs])
            for condition, own in self._common_to_networks(each)
            if len(self.networks) > 1
        ]
        return [*over_all, *each]

    def _common_to_networks(self, rows: Iterable[AnyRow]) -> Iterator[tuple[Condition, list[AnyRow]]]:
        """The rows for each round trip and controller that all networks have."""
        found: dict[Condition, list[AnyRow]] = {}
        for row in rows:
            found.setdefault(row.condition._replace(network=ALL), []).append(row)
        order = list(self.looks)
        for condition in sorted(found, key=lambda each: (_rtt_order(each), order.index(each.controller))):
            if len(found[condition]) == len(self.networks):
                yield condition, found[condition]


def describe_run_counts(groups: Sequence[Group]) -> str:
    """A sentence about the number of runs behind means and ranges."""
    counts = sorted({len(group.runs) for group in groups})
    if counts == [1]:
        return "One run each." if len(groups) > 1 else "One run."
    blocks = [run.block for group in groups for run in group.runs]
    kinds = {"scenes": {each.scene for each in blocks}, "movements": {each.movement for each in blocks}}
    several = [f"{len(found)} {name}" for name, found in kinds.items() if len(found) > 1]
    of = f" ({' and '.join(several)})" if several else ""
    return f"Means over {' to '.join(map(str, dict.fromkeys((counts[0], counts[-1]))))} runs{of}, with their range."


def choose_baseline(groups: Groups, experiment: ExperimentRecord | None, asked: str | None) -> Controller | None:
    """The controller named `asked`, else the first in the experiment's file, else the first of the runs.

    None without runs. Raises StartError if no runs have the controller named `asked`.
    """
    present = {controller.name: controller for controller in groups.looks}
    if asked is not None and asked not in present:
        raise StartError(f"There are no runs of the controller {asked!r}, only of {', '.join(present) or 'none'}.")
    if asked is not None:
        return present[asked]
    for name in _planned_controllers(experiment):
        variants = [each for each in groups.looks if replace(each.unenhanced, over_h3=False).name == name]
        if variants:
            return present.get(name, variants[0])
    return next(iter(groups.looks), None)


def _planned_controllers(experiment: ExperimentRecord | None) -> list[str]:
    """Controller names in the order of the experiment's file; a plan made on the page may have none."""
    plan = {} if experiment is None else experiment.plan
    variants = plan.get("variants")
    first = variants[0] if isinstance(variants, list) and variants and isinstance(variants[0], dict) else {}
    modes, controllers = (first.get(name, plan.get(name)) for name in ("modes", "controllers"))
    if not isinstance(modes, list) or not isinstance(controllers, list):
        return []
    names = [f"profile-{each}" if isinstance(each, int) else str(each) for each in controllers]
    of_mode = {"stateless": names, "video": [f"video-{name}" for name in names]}
    return [name for mode in modes for name in of_mode.get(str(mode), [str(mode)])]


def _rtt_order(condition: Condition) -> float:
    """Sort key of a round trip: unknown ones first."""
    return -1.0 if condition.rtt_ms is None else condition.rtt_ms
