"""The paper's claims, and our own, held against the runs where they apply."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from tigas_common.wire.figures import INTERACTIVE_MS
from tigas_experiments.report.controllers import CONTROLLER_TITLES
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.metrics import (
    FRAME_AGE_P95,
    HEIGHT,
    IN_TIME,
    NEW_VIEWS,
    RESPONSE_TIME_P95,
    SWITCHES,
    VIEW_SSIM,
    Metric,
)

Verdict = Literal["holds", "does not hold", "no data"]
READINGS = ("latency", "latency-transfer")
"""Of the paper's controller (docs/abr.md): its words come first, the other is judged where it has runs."""
RESPONSE_MS, RESPONSE_RTT_MS = 100.0, 50.0
SPANS = {RESPONSE_TIME_P95: "from asking to the last byte", FRAME_AGE_P95: "from the pose to the screen"}
"""The paper's, which runs without replies do not have, and the longer one that all have."""
FRAMES_PER_S, FRAMES_RTT_MS = 25.0, 300.0


@dataclass(frozen=True, slots=True)
class Claim:
    """One, and what the runs say of it."""

    text: str
    whose: Literal["the paper's", "ours"]
    verdict: Verdict
    figures: str
    """What the verdict rests on."""


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
    return [claim for reading in readings for claim in _of_reading(cells, reading)]


def _of_reading(cells: dict[tuple[str, float | None], Cell], reading: str) -> list[Claim]:
    """All that concern one reading of Latency."""
    title = CONTROLLER_TITLES[reading]
    every = list(cells.values())
    return [
        _fewer_switches(every, reading, "lol+"),
        _fewer_switches(every, reading, "l2a"),
        *_each_network(
            cells,
            reading,
            lambda rtt: rtt <= RESPONSE_RTT_MS,
            {
                metric: f"{title}'s p95 response, {span}, is under 100 ms at round trips of up to 50 ms"
                for metric, span in SPANS.items()
            },
            lambda value: value < RESPONSE_MS,
        ),
        *_each_network(
            cells,
            reading,
            lambda rtt: rtt == FRAMES_RTT_MS,
            {NEW_VIEWS: f"{title} shows at least 25 new views a second at a round trip of 300 ms"},
            lambda value: value >= FRAMES_PER_S,
        ),
        _budget(every, reading, HEIGHT, "at an equal or greater height"),
        _budget(every, reading, VIEW_SSIM, "at an equal or better SSIM of the view"),
    ]


def _fewer_switches(cells: Sequence[Cell], reading: str, other: str) -> Claim:
    own, title = CONTROLLER_TITLES[reading], CONTROLLER_TITLES[other]
    text = f"{own} changes its profile less often than {title}"
    both = [cell for cell in cells if _pairs([cell], reading, other, SWITCHES)]
    if not both:
        return Claim(text, "the paper's", "no data", "There are no runs of both over the same network.")
    pairs = _pairs(both, reading, other, SWITCHES)
    ours, theirs = (sum(pair[side] for pair in pairs) / len(pairs) for side in (0, 1))
    fewer = sum(a < b for a, b in pairs)
    figures = (
        f"{own} {SWITCHES.text(ours)}, {title} {SWITCHES.text(theirs)} a minute; "
        f"less often at {fewer} of {len(pairs)} networks and round trips."
    )
    return Claim(text, "the paper's", _verdict(ours < theirs), figures + _saturated(both, reading, other))


def _each_network(
    cells: dict[tuple[str, float | None], Cell],
    reading: str,
    applies: Callable[[float], bool],
    texts: Mapping[Metric, str],
    holds: Callable[[float], bool],
) -> list[Claim]:
    """A claim over one reading of Latency alone: one row for each network that has runs at such a round trip.

    It is judged by the first of the figures that all of its runs have, or by the last.
    """
    *_, last = texts
    found: list[Claim] = []
    for network in dict.fromkeys(network for network, _ in cells):
        at = {rtt: cell for (name, rtt), cell in cells.items() if name == network and rtt is not None and applies(rtt)}
        groups = [cell[reading] for cell in at.values() if reading in cell]
        metric = next((metric for metric in texts if all(group.has(metric) for group in groups)), last)
        values = {rtt: value for rtt, cell in at.items() if (value := _mean(cell, reading, metric)) is not None}
        if not values:
            continue
        parts = []
        for rtt, value in values.items():
            others = [
                f"{group.controller.title} {metric.text(other)}"
                for name, group in at[rtt].items()
                if name != reading and (other := _mean(at[rtt], name, metric)) is not None
            ]
            beside = f" ({', '.join(others)})" if others else ""
            parts.append(f"{metric.with_unit(value)} at {rtt:g} ms{beside}")
        figures = f"{'; '.join(parts)}.{_saturated(list(at.values()), reading)}"
        verdict = _verdict(all(map(holds, values.values())))
        found.append(Claim(f"{texts[metric]}, over {network}", "the paper's", verdict, figures))
    nothing = f"There are no runs of {CONTROLLER_TITLES[reading]} at such a known round trip."
    return found or [Claim(next(iter(texts.values())), "the paper's", "no data", nothing)]


def _budget(cells: Sequence[Cell], reading: str, quality: Metric, words: str) -> Claim:
    title = CONTROLLER_TITLES[reading]
    text = f"Budget has more inputs within {INTERACTIVE_MS:g} ms than {title}, {words}"
    both = [
        cell
        for cell in cells
        if _pairs([cell], "budget", reading, IN_TIME) and _pairs([cell], "budget", reading, quality)
    ]
    if not both:
        return Claim(text, "ours", "no data", "There are no runs of both over the same network that have the figure.")
    shares, qualities = (_pairs(both, "budget", reading, metric) for metric in (IN_TIME, quality))
    (in_time, theirs), (good, their_quality) = (
        tuple(sum(pair[side] for pair in pairs) / len(pairs) for side in (0, 1)) for pairs in (shares, qualities)
    )
    won = sum(a > b and c >= d for (a, b), (c, d) in zip(shares, qualities, strict=True))
    figures = (
        f"Budget {IN_TIME.with_unit(in_time)} at {quality.with_unit(good)}, {title} {IN_TIME.with_unit(theirs)} at "
        f"{quality.with_unit(their_quality)}; both are so at {won} of {len(both)} networks and round trips."
    )
    verdict = _verdict(in_time > theirs and good >= their_quality)
    return Claim(text, "ours", verdict, figures + _saturated(both, "budget", reading))


def _pairs(cells: Sequence[Cell], one: str, other: str, metric: Metric) -> list[tuple[float, float]]:
    """Means of both, in the cells that have both."""
    means = [(_mean(cell, one, metric), _mean(cell, other, metric)) for cell in cells]
    return [(a, b) for a, b in means if a is not None and b is not None]


def _mean(cell: Cell, name: str, metric: Metric) -> float | None:
    spread = cell[name].spread(metric) if name in cell else None
    return None if spread is None else spread.mean


def _verdict(holds: bool) -> Verdict:
    return "holds" if holds else "does not hold"


def _saturated(cells: Sequence[Cell], *names: str) -> str:
    """What the figures owe to the machine."""
    runs = [run for cell in cells for name in names if name in cell for run in cell[name].runs]
    saturated = sum(run.saturated for run in runs)
    if not saturated:
        return ""
    which = "all of these" if saturated == len(runs) else f"{saturated} of these {len(runs)}"
    return f" Processors were saturated in {which} runs."
