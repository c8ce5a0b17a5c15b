"""What to use when: over each network, in each scene, which mode is the best by each figure that decides it.

Modes are compared in the blocks that all of them have. The best is the one with the best mean; of another one no
difference is shown if the interval of its paired difference (blocks.py) has zero in it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from tigas_common.wire.run import LOCAL
from tigas_experiments.report.blocks import LEAST_BLOCKS, Estimate, differences
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.groups import Condition, Group, Groups, overall
from tigas_experiments.report.metrics import (
    OVER_LINK,
    PHOTON_P50,
    PHOTON_P95,
    RECEIVED,
    SEEN_SSIM,
    Metric,
)

QUESTIONS: dict[str, tuple[Metric, ...]] = {
    "Lowest motion-to-photon p50": (PHOTON_P50,),
    "Lowest motion-to-photon p95": (PHOTON_P95,),
    "Best picture seen": (SEEN_SSIM,),
    "Fewest bytes": (OVER_LINK, RECEIVED),
}
"""What is asked, and the figure that answers it: the first that runs have."""
ALL_NETWORKS = "all networks"
Row = dict[str, str | float | bool | None]


@dataclass(frozen=True, slots=True)
class Contender:
    """A mode, and how far behind the best it is."""

    controller: Controller
    mean: float
    """Over the blocks."""
    behind: Estimate | None
    """Its figures less the best's; None of the best."""
    saturated: bool
    """The machine was the bottleneck in a run."""

    @property
    def name(self) -> str:
        """Marked if the machine was the bottleneck."""
        return self.controller.title_with_mode + "*" * self.saturated

    @property
    def verdict(self) -> str:
        """In words, as a file has it."""
        if self.behind is None:
            return "best"
        if self.behind.interval is None:
            return "no interval"
        return "worse" if self.behind.certain else "no difference shown"


@dataclass(frozen=True, slots=True)
class Answer:
    """Who is the best by a figure."""

    metric: Metric
    blocks: int
    contenders: tuple[Contender, ...]
    """From the best on."""

    @property
    def best(self) -> Contender:
        """By its mean."""
        return self.contenders[0]

    @property
    def decided(self) -> bool:
        """Whether there are blocks enough to tell the best from others."""
        return self.blocks >= LEAST_BLOCKS

    @property
    def alike(self) -> list[Contender]:
        """Those of which no difference from the best is shown."""
        return [each for each in self.contenders if each.verdict == "no difference shown"]

    def told(self, contender: Contender) -> str:
        """A mode with its figure."""
        return f"{contender.name} {self.metric.with_unit(contender.mean)}"

    @property
    def short(self) -> str:
        """As it counts beside others."""
        if not self.decided:
            return f"fewer than {LEAST_BLOCKS} blocks"
        return "no difference shown" if self.alike else self.best.controller.title_with_mode


@dataclass(frozen=True, slots=True)
class Even:
    """How long one may look at pictures until they have cost as much as a download."""

    download: Controller
    """The smallest."""
    bytes: int
    pictures: Controller
    """Those that cost least."""
    seconds: float

    @property
    def text(self) -> str:
        """As a sentence."""
        size, download = f"{self.bytes / 1e6:,.1f} MB", self.download.title_with_mode
        return f"{download} has {size} in all, as much as {self.seconds:,.0f} s of {self.pictures.title_with_mode}"


@dataclass(frozen=True, slots=True)
class Place:
    """A network at a round trip, in one scene or in all of them, and who is the best there."""

    network: str
    """Or ALL_NETWORKS."""
    rtt_ms: float | None
    scene: str | None
    """None: all."""
    scene_bytes: int | None
    """Of its file, if it is one scene and known."""
    answers: dict[str, Answer]
    """By what is asked; without what the runs have no figure for."""
    even: Even | None
    """None of all scenes, and unless there are runs of both."""

    @property
    def scene_text(self) -> str:
        """As it stands in a table."""
        if self.scene is None:
            return "all scenes"
        return self.scene if self.scene_bytes is None else f"{self.scene}, {self.scene_bytes / 1e6:,.1f} MB"


def places(groups: Groups) -> list[Place]:
    """Every network and round trip at which modes were compared, after all networks together: all scenes, and then
    each, the smallest first.
    """
    by_place: dict[tuple[str, float | None], list[Group]] = {}
    for group in (*_over_networks(groups), *groups):
        by_place.setdefault((group.condition.network, group.condition.rtt_ms), []).append(group)
    found = []
    for (network, rtt), own in by_place.items():
        sizes = _sizes(own)
        scenes = sorted(sizes, key=lambda scene: (sizes[scene], scene))
        for scene in [None, *scenes] if len(scenes) > 1 else scenes:
            within = own if scene is None else [part for group in own if (part := _in_scene(group, scene)) is not None]
            if len({group.controller.mode for group in within}) > 1:
                answers = {question: answer for question in QUESTIONS if (answer := _answer(within, question))}
                size, even = (sizes[scene] or None, _even(within)) if scene is not None else (None, None)
                found.append(Place(network, rtt, scene, size, answers, even))
    return found


def tally(found: Sequence[Place]) -> dict[str, list[tuple[str, int]]]:
    """How often each mode is the best by each figure, and how often that is not shown, over the places of one network
    and scene.
    """
    single = [place for place in found if place.scene is not None and place.network != ALL_NETWORKS]
    return {
        question: Counter(place.answers[question].short for place in single if question in place.answers).most_common()
        for question in QUESTIONS
        if any(question in place.answers for place in single)
    }


def rows(found: Sequence[Place]) -> Iterator[Row]:
    """A row for each mode at each place, by each figure."""
    for place in found:
        for question, answer in place.answers.items():
            for each in answer.contenders:
                low, high = (
                    (None, None) if each.behind is None or each.behind.interval is None else each.behind.interval
                )
                yield {
                    "network": place.network,
                    "rtt_ms": place.rtt_ms,
                    "scene": place.scene or "all",
                    "scene_bytes": place.scene_bytes,
                    "question": question,
                    "figure": answer.metric.name,
                    "controller": each.controller.name,
                    "blocks": answer.blocks,
                    "mean": each.mean,
                    "behind": None if each.behind is None or math.isnan(each.behind.mean) else each.behind.mean,
                    "ci95_low": low,
                    "ci95_high": high,
                    "verdict": each.verdict,
                    "saturated": each.saturated,
                }


def _over_networks(groups: Groups) -> list[Group]:
    """Each controller's runs over all networks, at the round trips that all have; none if there is one network."""
    if len(groups.networks) < 2:
        return []
    return [
        Group(
            Condition(ALL_NETWORKS, each.rtt_ms, each.controller),
            tuple(run for group in each.groups for run in group.runs),
        )
        for each in overall(groups)
    ]


def _sizes(groups: Sequence[Group]) -> dict[str, int]:
    """Each scene's file, in bytes: its own, or as large as it was downloaded; 0 if that is unknown."""
    sizes: dict[str, int] = {}
    for run in (run for group in groups for run in group.runs):
        local = run.record.recording and run.record.recording.local
        size = max(run.record.scene_bytes or 0, local.bytes if local else 0)
        scene = run.record.configuration.scene
        sizes[scene] = max(sizes.get(scene, 0), size)
    return sizes


def _even(groups: Sequence[Group]) -> Even | None:
    downloads = [
        (local.bytes, group.controller)
        for group in groups
        for run in group.runs
        if run.record.recording and (local := run.record.recording.local) and local.bytes
    ]
    pictures = [
        (spread.mean, group.controller)
        for group in groups
        if group.controller.mode not in LOCAL and (spread := group.spread(RECEIVED)) and spread.mean > 0
    ]
    if not downloads or not pictures:
        return None
    size, download = min(downloads, key=lambda pair: pair[0])
    mbit_s, leanest = min(pictures, key=lambda pair: pair[0])
    return Even(download, size, leanest, size * 8e-6 / mbit_s)


def _in_scene(group: Group, scene: str) -> Group | None:
    runs = tuple(run for run in group.runs if run.record.configuration.scene == scene)
    return Group(group.condition, runs) if runs else None


def _answer(groups: Sequence[Group], question: str) -> Answer | None:
    """None if fewer than two modes have the figure in a block that all of these have."""
    for metric in QUESTIONS[question]:
        values = {group.controller: blocks for group in groups if (blocks := group.blocks(metric))}
        if len(values) < len(groups) and metric is not QUESTIONS[question][-1]:
            continue
        common = set.intersection(*map(set, values.values())) if values else set()
        if not common or len({controller.mode for controller in values}) < 2:
            return None
        kept = {controller: {block: own[block] for block in common} for controller, own in values.items()}
        means = {controller: sum(own.values()) / len(own) for controller, own in kept.items()}
        sign = -1 if metric.better == "high" else 1
        ordered = sorted(means, key=lambda controller: sign * means[controller])
        best, saturated = kept[ordered[0]], {group.controller: group.saturated for group in groups}
        contenders = (
            Contender(
                each,
                means[each],
                None if kept[each] is best else Estimate.over([*differences(kept[each], best).values()]),
                saturated[each],
            )
            for each in ordered
        )
        return Answer(metric, len(common), tuple(contenders))
    return None
