"""The words of an experiment's figures: what is seen in them, in a sentence, and what they are over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.metrics import Metric
from tigas_experiments.report.results import Floats
from tigas_experiments.report.time_series import downloaded, received

ROOM = 18
MANY = 4
"""More figures than these are told by the lowest and the highest."""


def short(name: str) -> str:
    """As much of a name as there is room for beside an axis: its ends, which tell traces of one collection apart."""
    return name if len(name) <= ROOM else f"{name[: ROOM // 2]}…{name[ROOM // 2 + 1 - ROOM :]}"


def spread_of(groups: Sequence[Group]) -> str:
    """What the means and spreads are over."""
    counts = {len(group.runs) for group in groups}
    if counts == {1}:
        return "One run each."
    low, high = min(counts), max(counts)
    configurations = [run.record.configuration for group in groups for run in group.runs]
    kinds = {
        "scenes": len({configuration.scene for configuration in configurations}),
        "movements": len({configuration.movement for configuration in configurations}),
    }
    several = [f"{number} {name}" for name, number in kinds.items() if number > 1]
    of = f" ({' and '.join(several)})" if several else ""
    return f"Means over {low if low == high else f'{low} to {high}'} runs{of}, from the least to the greatest of them."


def at_base(groups: Groups, network: str) -> str:
    """A network at the one round trip that stands for it."""
    rtt = groups.base_rtt(network)
    return network if rtt is None else f"{network} at {rtt:g} ms round trip"


def at_lowest(groups: Groups) -> str:
    """At which round trips an overview is."""
    found = sorted({rtt for name in groups.networks if (rtt := groups.base_rtt(name)) is not None})
    if not found:
        return "as it is"
    return f"at its lowest round trip ({', '.join(f'{rtt:g}' for rtt in found)} ms)"


def means(groups: Sequence[Group], metric: Metric) -> dict[Controller, float]:
    """Of each controller, over its groups."""
    found: dict[Controller, list[float]] = {}
    for group in groups:
        if spread := group.spread(metric):
            found.setdefault(group.controller, []).append(spread.mean)
    return {controller: sum(values) / len(values) for controller, values in found.items()}


def each(groups: Sequence[Group], metric: Metric) -> str:
    """A figure of each controller; of the lowest and the highest where there are many."""
    found = means(groups, metric)
    parts = {controller: f"{controller.title} {metric.with_unit(mean)}" for controller, mean in found.items()}
    if len(parts) <= MANY:
        return ", ".join(parts.values()) or "none"
    lowest, highest = min(found, key=lambda one: found[one]), max(found, key=lambda one: found[one])
    return f"from {parts[lowest]} to {parts[highest]}"


def best(groups: Sequence[Group], metric: Metric) -> str:
    """Who has the most of a figure, and who the least."""
    found = means(groups, metric)
    if len(found) < 2:
        return f"{metric.title}: {each(groups, metric)}"
    most, fewest = max(found, key=lambda one: found[one]), min(found, key=lambda one: found[one])
    return (
        f"{most.title} has the most {metric.title.lower()}, {metric.with_unit(found[most])} on average; "
        f"{fewest.title} the fewest, {metric.with_unit(found[fewest])}"
    )


def change(groups: Sequence[Group], rtts: Sequence[float], metric: Metric) -> str:
    """What becomes of a figure between the lowest and the highest round trip."""
    ends = [each([group for group in groups if group.condition.rtt_ms == rtt], metric) for rtt in (rtts[0], rtts[-1])]
    return f"{metric.title} at {rtts[0]:g} ms round trip: {ends[0]}; at {rtts[-1]:g} ms: {ends[1]}"


def steadiness(groups: Sequence[Group]) -> str:
    """How far the frame ages of the groups' first runs lie apart."""
    ranges = {}
    for group in groups:
        low, high = np.percentile(group.runs[0].frame_ages[:, 1], (5, 95)).tolist()
        ranges[group.controller] = (high - low, f"{group.controller.title} {low:,.0f}–{high:,.0f} ms")
    ordered = [text for _, text in sorted(ranges.values())]
    shown = f"{ordered[0]} is the steadiest, {ordered[-1]} the least" if len(ordered) > 1 else ordered[0]
    return f"Frame age over time: {shown} (5th to 95th percentile)"


def against_download(groups: Sequence[Group], link: Floats | None, size: int | None) -> str:
    """What was received, and what would have become of a download of so many bytes over the same link."""
    totals = {group.controller.title: float(received(group)[1][-1]) for group in groups}
    parts = [f"{title} {megabytes:,.1f} MB" for title, megabytes in totals.items()]
    if len(parts) > MANY:
        lowest, highest = min(totals, key=lambda title: totals[title]), max(totals, key=lambda title: totals[title])
        parts = [f"from {lowest} {totals[lowest]:,.1f} to {highest} {totals[highest]:,.1f} MB"]
    found = f"Received: {', '.join(parts)}"
    if link is None or size is None:
        return found
    loaded, whole = downloaded(link), size / 1e6
    if loaded[-1] >= whole:
        done = float(link[int(np.argmax(loaded >= whole)), 0])
        return f"{found}; the scene's {whole:,.1f} MB would have been downloaded after {done:,.1f} s"
    share = 100 * float(loaded[-1]) / whole
    return f"{found}; of the scene's {whole:,.1f} MB, {share:,.0f} % could have been downloaded in that time"
