"""The paper's claims, and our own targets, held against the runs where they apply.

A verdict is what the whole 95 % confidence interval over blocks (blocks.py) says; without one it is `not certain`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from tigas_common.wire.figures import INTERACTIVE_MS
from tigas_experiments.report.blocks import Block, Estimate, differences, signed
from tigas_experiments.report.controllers import CONTROLLER_TITLES
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.metrics import (
    FRAME_AGE_MEAN,
    FRAME_AGE_P95,
    HEIGHT,
    IN_TIME,
    NEW_VIEWS,
    RESPONSE_TIME_MEAN,
    RESPONSE_TIME_P95,
    SEEN_SSIM,
    SWITCHES,
    Metric,
)
from tigas_experiments.report.reprojection_claims import reprojection_claims
from tigas_experiments.report.verdicts import OURS, Claim, Verdict, all_of, judged, of_interval

SWITCHES_IN_PAPER = "the paper's: Performance Evaluation, Results, (d) Quality Switches"
RESPONSE_IN_PAPER = "the paper's: Performance Evaluation, Impact of Round-Trip Time"
READINGS = ("latency", "latency-transfer")
"""Of the paper's controller (docs/abr.md): its words come first, the other is judged where it has runs."""
BASELINES = ("lol+", "l2a")
"""The paper's."""
RESPONSE_MS, RESPONSE_RTT_MS = 100.0, 50.0
SPANS = {RESPONSE_TIME_P95: "from asking to the last byte", FRAME_AGE_P95: "from the pose to the screen"}
"""The paper's notion, which runs without replies do not have, and the longer one that all have."""
FRAMES_PER_S, FRAMES_RTT_MS = 25.0, 300.0


Cell = dict[str, Group]
"""Controller → its runs, over one network at one round trip."""


def claims(groups: Groups) -> list[Claim]:
    """All of them, with `no data` where the runs say nothing."""
    cells: dict[tuple[str, float | None], Cell] = {}
    for group in groups:
        condition = group.condition
        cells.setdefault((condition.network, condition.rtt_ms), {})[condition.controller.name] = group
    first, *others = READINGS
    readings = [first, *(name for name in others if any(name in cell for cell in cells.values()))]
    return [*reprojection_claims(groups), *(claim for reading in readings for claim in _of_reading(cells, reading))]


def _of_reading(cells: dict[tuple[str, float | None], Cell], reading: str) -> list[Claim]:
    """All that concern one reading of Latency."""
    title = CONTROLLER_TITLES[reading]
    every = list(cells.values())
    return [
        *(_fewer_switches(every, reading, other) for other in BASELINES),
        *(_slower(every, reading, other) for other in BASELINES),
        *_each_network(
            cells,
            reading,
            lambda rtt: rtt <= RESPONSE_RTT_MS,
            {
                metric: f"{title}'s p95 response, {span}, is under 100 ms at round trips of up to 50 ms"
                for metric, span in SPANS.items()
            },
            lambda low, high: judged(high < RESPONSE_MS, low >= RESPONSE_MS),
        ),
        *_each_network(
            cells,
            reading,
            lambda rtt: rtt == FRAMES_RTT_MS,
            {NEW_VIEWS: f"{title} shows at least 25 new views a second at a round trip of 300 ms"},
            lambda low, high: judged(low >= FRAMES_PER_S, high < FRAMES_PER_S),
        ),
        _budget(every, reading, HEIGHT, "at an equal or greater height"),
        _budget(every, reading, SEEN_SSIM, "at an equal or better SSIM of what is seen"),
    ]


def _fewer_switches(cells: Sequence[Cell], reading: str, other: str) -> Claim:
    own, title = CONTROLLER_TITLES[reading], CONTROLLER_TITLES[other]
    text = f"{own} changes its profile less often than {title}"
    both = [cell for cell in cells if _pairs([cell], reading, other, SWITCHES)]
    if not both:
        return _nothing(text, SWITCHES_IN_PAPER)
    pairs, estimate = _pairs(both, reading, other, SWITCHES), _difference(both, reading, other, SWITCHES)
    ours, theirs = _means(pairs)
    fewer = sum(a < b for a, b in pairs)
    figures = (
        f"{own} {SWITCHES.text(ours)}, {title} {SWITCHES.text(theirs)} a minute; "
        f"{_told(estimate, SWITCHES)}; less often at {fewer} of {len(pairs)} networks and round trips."
    )
    verdict = of_interval(estimate, lambda low, high: judged(high < 0, low >= 0))
    return Claim(text, SWITCHES_IN_PAPER, verdict, figures + _saturated(both, reading, other))


def _slower(cells: Sequence[Cell], reading: str, other: str) -> Claim:
    """Of how little it is slower, the paper says nothing that could be judged."""
    own, title = CONTROLLER_TITLES[reading], CONTROLLER_TITLES[other]
    text = f"{own}'s mean response is longer than {title}'s"
    metric = RESPONSE_TIME_MEAN if _pairs(cells, reading, other, RESPONSE_TIME_MEAN) else FRAME_AGE_MEAN
    both = [cell for cell in cells if _pairs([cell], reading, other, metric)]
    if not both:
        return _nothing(text, RESPONSE_IN_PAPER)
    pairs, estimate = _pairs(both, reading, other, metric), _difference(both, reading, other, metric)
    ours, theirs = _means(pairs)
    figures = (
        f"{metric.title}: {own} {metric.with_unit(ours)}, {title} {metric.with_unit(theirs)}; "
        f"{_told(estimate, metric)}."
    )
    verdict = of_interval(estimate, lambda low, high: judged(low > 0, high <= 0))
    return Claim(text, RESPONSE_IN_PAPER, verdict, figures + _saturated(both, reading, other))


def _each_network(
    cells: dict[tuple[str, float | None], Cell],
    reading: str,
    applies: Callable[[float], bool],
    texts: Mapping[Metric, str],
    judge: Callable[[float, float], Verdict],
) -> list[Claim]:
    """A target for one reading of Latency alone: one row for each network that has runs at such a round trip.

    It is judged by the first of the figures that all of its runs have, or by the last, at each round trip by itself.
    """
    *_, last = texts
    found: list[Claim] = []
    for network in dict.fromkeys(network for network, _ in cells):
        at = {rtt: cell for (name, rtt), cell in cells.items() if name == network and rtt is not None and applies(rtt)}
        groups = [cell[reading] for cell in at.values() if reading in cell]
        metric = next((metric for metric in texts if all(group.has(metric) for group in groups)), last)
        estimates = {
            rtt: estimate
            for rtt, cell in at.items()
            if reading in cell and (estimate := cell[reading].estimate(metric)) is not None
        }
        if not estimates:
            continue
        parts = []
        for rtt, estimate in estimates.items():
            others = [
                f"{group.controller.title} {metric.text(other)}"
                for name, group in at[rtt].items()
                if name != reading and (other := _mean(at[rtt], name, metric)) is not None
            ]
            beside = f" ({', '.join(others)})" if others else ""
            parts.append(f"{metric.with_unit(estimate.mean)} {estimate.range(metric)} at {rtt:g} ms{beside}")
        figures = f"{'; '.join(parts)}.{_saturated(list(at.values()), reading)}"
        verdict = all_of(of_interval(estimate, judge) for estimate in estimates.values())
        found.append(Claim(f"{texts[metric]}, over {network}", OURS, verdict, figures))
    nothing = f"There are no runs of {CONTROLLER_TITLES[reading]} at such a known round trip."
    return found or [Claim(next(iter(texts.values())), OURS, "no data", nothing)]


def _budget(cells: Sequence[Cell], reading: str, quality: Metric, words: str) -> Claim:
    title = CONTROLLER_TITLES[reading]
    text = f"Budget has more inputs within {INTERACTIVE_MS:g} ms than {title}, {words}"
    both = [
        cell
        for cell in cells
        if _pairs([cell], "budget", reading, IN_TIME) and _pairs([cell], "budget", reading, quality)
    ]
    if not both:
        return _nothing(text, OURS)
    shares, qualities = (_pairs(both, "budget", reading, metric) for metric in (IN_TIME, quality))
    (in_time, theirs), (good, their_quality) = _means(shares), _means(qualities)
    won = sum(a > b and c >= d for (a, b), (c, d) in zip(shares, qualities, strict=True))
    more, better = (_difference(both, "budget", reading, metric) for metric in (IN_TIME, quality))
    figures = (
        f"Budget {IN_TIME.with_unit(in_time)} at {quality.with_unit(good)}, {title} {IN_TIME.with_unit(theirs)} at "
        f"{quality.with_unit(their_quality)}; {_told(more, IN_TIME)}, and of {quality.title} "
        f"{_told(better, quality)}; both are so at {won} of {len(both)} networks and round trips."
    )
    verdict = all_of(
        (
            of_interval(more, lambda low, high: judged(low > 0, high <= 0)),
            of_interval(better, lambda low, high: judged(low >= 0, high < 0)),
        )
    )
    return Claim(text, OURS, verdict, figures + _saturated(both, "budget", reading))


def _nothing(text: str, whose: str) -> Claim:
    return Claim(text, whose, "no data", "There are no runs of both over the same network that have the figure.")


def _difference(cells: Sequence[Cell], one: str, other: str, metric: Metric) -> Estimate | None:
    """Of one less the other, over the blocks that both have; a block's round trips are averaged first."""
    found: dict[Block, list[float]] = {}
    for cell in cells:
        if one in cell and other in cell:
            for block, value in differences(cell[one].blocks(metric), cell[other].blocks(metric)).items():
                found.setdefault(block, []).append(value)
    return Estimate.over([sum(values) / len(values) for values in found.values()])


def _pairs(cells: Sequence[Cell], one: str, other: str, metric: Metric) -> list[tuple[float, float]]:
    """Means of both, in the cells that have both."""
    means = [(_mean(cell, one, metric), _mean(cell, other, metric)) for cell in cells]
    return [(a, b) for a, b in means if a is not None and b is not None]


def _means(pairs: Sequence[tuple[float, float]]) -> tuple[float, float]:
    return sum(a for a, _ in pairs) / len(pairs), sum(b for _, b in pairs) / len(pairs)


def _mean(cell: Cell, name: str, metric: Metric) -> float | None:
    spread = cell[name].spread(metric) if name in cell else None
    return None if spread is None else spread.mean


def _told(estimate: Estimate | None, metric: Metric) -> str:
    if estimate is None:
        return "they have no block in common"
    return f"difference {signed(metric, estimate.mean)} {estimate.range(metric)}"


def _saturated(cells: Sequence[Cell], *names: str) -> str:
    """What the figures owe to the machine."""
    runs = [run for cell in cells for name in names if name in cell for run in cell[name].runs]
    saturated = sum(run.saturated for run in runs)
    if not saturated:
        return ""
    which = "all of these" if saturated == len(runs) else f"{saturated} of these {len(runs)}"
    return f" Processors were saturated in {which} runs."
