"""Paired differences of each controller from a baseline, block by block over the same networks and round trips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tigas_common.errors import StartError
from tigas_experiments.records.folder import ExperimentRecord
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.estimates import Estimate, paired
from tigas_experiments.report.groups import Group, Groups, rtt_order
from tigas_experiments.report.metrics import Metric


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """A controller against the baseline at one round trip, over one network or all of them."""

    network: str | None
    """None for all networks."""
    rtt_ms: float | None
    controller: Controller
    pairs: tuple[tuple[Group, Group], ...]
    """Groups of the controller and of the baseline, one pair per network."""

    def estimate(self, metric: Metric) -> Estimate | None:
        """Mean difference over all common blocks; None without any."""
        values = [paired(own.blocks(metric), base.blocks(metric)) for own, base in self.pairs]
        return Estimate.over([value for found in values for value in found.values()], metric.step)

    @property
    def blocks(self) -> int:
        """Number of common blocks."""
        return sum(len(own.all_blocks & base.all_blocks) for own, base in self.pairs)


def against(groups: Groups, baseline: Controller) -> list[Difference]:
    """Differences over all networks at their common round trips, then over each network."""
    each: list[Difference] = []
    for network, rtt in groups.conditions:
        by_controller = {group.controller: group for group in groups.at(network, rtt)}
        base = by_controller.pop(baseline, None)
        if base is not None:
            each += [Difference(network, rtt, own, ((group, base),)) for own, group in by_controller.items()]
    return [*_over_all(groups, each), *each]


def _over_all(groups: Groups, each: Sequence[Difference]) -> list[Difference]:
    found = []
    if len(groups.networks) > 1:
        for rtt in sorted({one.rtt_ms for one in each}, key=rtt_order):
            for controller in groups.looks:
                own = [one for one in each if (one.rtt_ms, one.controller) == (rtt, controller)]
                if len(own) == len(groups.networks):
                    found.append(Difference(None, rtt, controller, tuple(pair for one in own for pair in one.pairs)))
    return found


def choose_baseline(groups: Groups, experiment: ExperimentRecord | None, asked: str | None) -> Controller | None:
    """The controller named `asked`, else the first in the experiment's file, else the first of the runs.

    None without runs. Raises StartError if there are no runs of the controller named `asked`.
    """
    present = {controller.name: controller for controller in groups.looks}
    if asked is not None:
        if asked not in present:
            raise StartError(f"There are no runs of the controller {asked!r}, only of {', '.join(present) or 'none'}.")
        return present[asked]
    return next((present[name] for name in [*_planned(experiment), *present] if name in present), None)


def _planned(experiment: ExperimentRecord | None) -> list[str]:
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
