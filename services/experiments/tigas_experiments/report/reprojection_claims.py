"""The goals of late reprojection and prediction (docs/reprojection.md), held against runs with it and without.

`with` is each controller of which there are runs with reprojection, and `without` its counterpart: the same controller
without, or the default one. Fixed rungs count only where nothing else was turned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from tigas_experiments.report.blocks import Block, Estimate, differences, signed
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.metrics import (
    SEEN_LPIPS,
    SEEN_SSIM,
    UNCOVERED,
    VIEW_LATENCY_P50,
    VIEW_LATENCY_P95,
    WARP_MEAN,
    Metric,
)
from tigas_experiments.report.rate_distortion import RateDistortion
from tigas_experiments.report.verdicts import OURS, Claim, Verdict, all_of, judged, of_interval

DEFAULT = "budget"
VIEW_MS, WARP_MS, NEVER_SEEN_PCT = 34.0, 2.0, 2.0
"""A frame at 60 Hz and the display's own; of the page's main thread for each picture; of the picture."""
NEAR_MS, FAR_MS, BORDER_MS = 20.0, 300.0, 100.0
QUALITIES = (SEEN_SSIM, SEEN_LPIPS)


def reprojection_claims(groups: Groups) -> list[Claim]:
    """None without runs that were turned."""
    turned = [controller for controller in groups.looks if "reprojection" in controller.motion]
    chosen = [controller for controller in turned if not controller.fixed] or turned
    return [claim for controller in chosen for claim in _of(groups, controller, _counterpart(groups, controller))]


def _counterpart(groups: Groups, turned: Controller) -> Controller | None:
    """Of the same mode, without reprojection and prediction."""
    plain = [one for one in groups.looks if one.mode == turned.mode and not one.motion]
    same = [one for one in plain if one.profile == turned.profile and one.representation == turned.representation]
    default = [one for one in plain if one.profile == DEFAULT]
    return next(iter(same or default or [one for one in plain if not one.fixed]), None)


def _of(groups: Groups, turned: Controller, plain: Controller | None) -> Iterator[Claim]:
    rtts = sorted({group.condition.rtt_ms for group in groups if group.condition.rtt_ms is not None})
    yield _bounded(
        groups,
        turned,
        f"{turned.title}: p95 of view latency is at most {VIEW_MS:g} ms at any round trip up to {FAR_MS:g} ms",
        [rtt for rtt in rtts if rtt <= FAR_MS],
        VIEW_LATENCY_P95,
        VIEW_MS,
        beside=(VIEW_LATENCY_P50, plain),
    )
    if plain is not None:
        for metric in QUALITIES:
            yield _as_near(groups, turned, plain, metric)
            yield _better(groups, turned, plain, metric, [rtt for rtt in rtts if NEAR_MS <= rtt <= BORDER_MS])
        yield from _at_equal_rates(groups, turned, [rtt for rtt in rtts if NEAR_MS <= rtt <= BORDER_MS])
    yield _bounded(
        groups,
        turned,
        f"{turned.title}: at most {NEVER_SEEN_PCT:g} % of the picture never seen at {BORDER_MS:g} ms, recorded heads",
        [rtt for rtt in rtts if rtt == BORDER_MS],
        UNCOVERED,
        NEVER_SEEN_PCT,
        recorded=True,
    )
    yield _bounded(
        groups,
        turned,
        f"{turned.title}: turning keeps the page's main thread for at most {WARP_MS:g} ms a picture",
        rtts,
        WARP_MEAN,
        WARP_MS,
    )


def _bounded(
    groups: Groups,
    turned: Controller,
    text: str,
    rtts: list[float],
    metric: Metric,
    most: float,
    *,
    beside: tuple[Metric, Controller | None] | None = None,
    recorded: bool = False,
) -> Claim:
    """A figure, over all blocks of all networks, at each of some round trips."""
    parts, verdicts = [], []
    for rtt in rtts:
        estimate = Estimate.over(
            [
                value
                for group in _at(groups, turned, rtt)
                for block, value in group.blocks(metric).items()
                if not recorded or _is_recorded(block)
            ]
        )
        if estimate is None:
            continue
        told = f"{metric.with_unit(estimate.mean)} {estimate.range(metric)} at {rtt:g} ms"
        if beside is not None:
            told += _beside(groups, turned, rtt, metric, *beside)
        parts.append(told)
        verdicts.append(of_interval(estimate, lambda low, high: judged(high <= most, low > most)))
    if not parts:
        return Claim(text, OURS, "no data", "There are no such runs that have the figure.")
    return Claim(text, OURS, all_of(verdicts), f"{'; '.join(parts)}.")


def _beside(
    groups: Groups, turned: Controller, rtt: float, metric: Metric, median: Metric, plain: Controller | None
) -> str:
    """The median, and the same of its counterpart."""
    told = [
        f"{name} {figure.text(estimate.mean)}"
        for name, controller, figure in (("p50", turned, median), ("without p95", plain, metric))
        if controller is not None
        and (estimate := Estimate.over([v for g in _at(groups, controller, rtt) for v in g.blocks(figure).values()]))
    ]
    return f" ({', '.join(told)})" if told else ""


def _as_near(groups: Groups, turned: Controller, plain: Controller, metric: Metric) -> Claim:
    """Far away with it against near without it."""
    text = f"{turned.title}: {metric.title} at {FAR_MS:g} ms is no worse than {plain.title}'s at {NEAR_MS:g} ms"
    estimate = _difference(groups, (turned, FAR_MS), (plain, NEAR_MS), metric)
    if estimate is None:
        return _nothing(text)
    judge = _no_worse(metric)
    return Claim(
        text,
        OURS,
        of_interval(estimate, judge),
        f"{_means(groups, turned, FAR_MS, plain, NEAR_MS, metric)}"
        f"difference {signed(metric, estimate.mean)} {estimate.range(metric)}.",
    )


def _better(groups: Groups, turned: Controller, plain: Controller, metric: Metric, rtts: list[float]) -> Claim:
    """At equal networks and round trips."""
    text = f"{turned.title}: {metric.title} is better than {plain.title}'s at round trips of 20 to 100 ms"
    parts, verdicts = [], []
    for rtt in rtts:
        estimate = _difference(groups, (turned, rtt), (plain, rtt), metric)
        if estimate is not None:
            parts.append(f"{signed(metric, estimate.mean)} {estimate.range(metric)} at {rtt:g} ms")
            verdicts.append(of_interval(estimate, _surely_better(metric)))
    if not parts:
        return _nothing(text)
    return Claim(text, OURS, all_of(verdicts), f"Difference: {'; '.join(parts)}.")


def _at_equal_rates(groups: Groups, turned: Controller, rtts: list[float]) -> Iterator[Claim]:
    """Against the curve of fixed rungs without, where there is one."""
    text = f"{turned.title}: {SEEN_SSIM.title} is better than fixed rungs' without, at equal Mbit/s and 20 to 100 ms"
    parts: list[str] = []
    verdicts: list[Verdict] = []
    for rtt in rtts:
        own = [group for group in groups if group.condition.rtt_ms == rtt]
        found = RateDistortion.of(own, None, rtt)
        for pair in () if found is None else found.equal_rates:
            if pair.curve.controllers[0].motion or turned not in pair.other.controllers:
                continue
            if pair.curve.controllers[0].mode != turned.mode:
                continue
            estimate = pair.differences.get(SEEN_SSIM)
            if estimate is None:
                parts.append(f"{pair.apart} at {rtt:g} ms")
                verdicts.append("not certain")
            else:
                parts.append(
                    f"{signed(SEEN_SSIM, estimate.mean)} {estimate.range(SEEN_SSIM)} at {rtt:g} ms "
                    f"({pair.overlapping} of {pair.blocks} blocks overlap)"
                )
                verdicts.append(of_interval(estimate, _surely_better(SEEN_SSIM)))
    if parts:
        yield Claim(text, OURS, all_of(verdicts), f"Difference: {'; '.join(parts)}.")


def _difference(
    groups: Groups, one: tuple[Controller, float], other: tuple[Controller, float], metric: Metric
) -> Estimate | None:
    """Of one less the other over the blocks of all networks that both have; each has a round trip of its own."""
    others = {group.condition.network: group for group in _at(groups, *other)}
    return Estimate.over(
        [
            value
            for group in _at(groups, *one)
            if group.condition.network in others
            for value in differences(group.blocks(metric), others[group.condition.network].blocks(metric)).values()
        ]
    )


def _means(groups: Groups, one: Controller, rtt: float, other: Controller, other_rtt: float, metric: Metric) -> str:
    told = [
        f"{name} {metric.text(estimate.mean)}"
        for name, controller, at in (("with", one, rtt), ("without", other, other_rtt))
        if (estimate := Estimate.over([v for g in _at(groups, controller, at) for v in g.blocks(metric).values()]))
    ]
    return f"{', '.join(told)}; " if told else ""


def _at(groups: Groups, controller: Controller, rtt: float) -> list[Group]:
    return [group for group in groups if group.controller == controller and group.condition.rtt_ms == rtt]


def _is_recorded(block: Block) -> bool:
    return block.movement.endswith(".csv")  # generated movements are no files


def _surely_better(metric: Metric) -> Callable[[float, float], Verdict]:
    if metric.better == "low":
        return lambda low, high: judged(high < 0, low >= 0)
    return lambda low, high: judged(low > 0, high <= 0)


def _no_worse(metric: Metric) -> Callable[[float, float], Verdict]:
    if metric.better == "low":
        return lambda low, high: judged(high <= 0, low > 0)
    return lambda low, high: judged(low >= 0, high < 0)


def _nothing(text: str) -> Claim:
    return Claim(text, OURS, "no data", "There are no runs of both in the same blocks that have the figure.")
