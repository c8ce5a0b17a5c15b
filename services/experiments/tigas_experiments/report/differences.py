"""What each controller's figures are less a baseline's, block by block, over the same networks and round trips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tigas_common.errors import StartError
from tigas_experiments.records.folder import ExperimentRecord
from tigas_experiments.report.blocks import Estimate, differences
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.metrics import Metric


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """A controller against the baseline, over one network or all of them, at one round trip."""

    network: str | None
    """None: over all."""
    rtt_ms: float | None
    controller: Controller
    pairs: tuple[tuple[Group, Group], ...]
    """The controller's runs and the baseline's, network by network."""

    def estimate(self, metric: Metric) -> Estimate | None:
        """The mean difference over all blocks that both have; None if there is none."""
        return Estimate.over(
            [
                value
                for own, base in self.pairs
                for value in differences(own.blocks(metric), base.blocks(metric)).values()
            ]
        )

    @property
    def blocks(self) -> int:
        """That both have runs of."""
        return sum(len(own.every_block & base.every_block) for own, base in self.pairs)


def against(groups: Groups, baseline: Controller) -> list[Difference]:
    """Of all controllers but the baseline: over all networks at the round trips that all have, then over each."""
    conditions = list(dict.fromkeys((group.condition.network, group.condition.rtt_ms) for group in groups))
    each: list[Difference] = []
    for network, rtt in conditions:
        by_controller = {group.controller: group for group in groups.at(network, rtt)}
        base = by_controller.pop(baseline, None)
        if base is not None:
            each += [Difference(network, rtt, own, ((group, base),)) for own, group in by_controller.items()]
    return [*_over_all(groups, each), *each]


def _over_all(groups: Groups, each: Sequence[Difference]) -> list[Difference]:
    networks = groups.networks
    if len(networks) < 2:
        return []
    by_key: dict[tuple[float | None, Controller], list[Difference]] = {}
    for rtt in sorted({one.rtt_ms for one in each}, key=lambda rtt: -1.0 if rtt is None else rtt):
        for controller in groups.looks:
            by_key[rtt, controller] = [one for one in each if (one.rtt_ms, one.controller) == (rtt, controller)]
    return [
        Difference(None, rtt, controller, tuple(pair for one in found for pair in one.pairs))
        for (rtt, controller), found in by_key.items()
        if len(found) == len(networks)
    ]


def choose_baseline(groups: Groups, experiment: ExperimentRecord | None, asked: str | None) -> Controller | None:
    """By its name; otherwise the first that the experiment's file names, or of the runs. None without runs.

    Raises StartError if there are no runs of the one that was asked for.
    """
    present = {controller.name: controller for controller in groups.looks}
    if asked is not None:
        if asked not in present:
            raise StartError(f"There are no runs of the controller {asked!r}, only of {', '.join(present) or 'none'}.")
        return present[asked]
    return next((present[name] for name in [*_planned(experiment), *present] if name in present), None)


def _planned(experiment: ExperimentRecord | None) -> list[str]:
    """Names of controllers in the file's order; a page's plan may say nothing of them."""
    plan = {} if experiment is None else experiment.plan
    variants = plan.get("variants")
    first = variants[0] if isinstance(variants, list) and variants and isinstance(variants[0], dict) else {}
    modes, controllers = (first.get(name, plan.get(name)) for name in ("modes", "controllers"))
    if not isinstance(modes, list) or not isinstance(controllers, list):
        return []
    names = [f"profile-{each}" if isinstance(each, int) else str(each) for each in controllers]
    of_mode = {"stateless": names, "video": [f"video-{name}" for name in names]}
    return [name for mode in modes for name in of_mode.get(str(mode), [str(mode)])]
