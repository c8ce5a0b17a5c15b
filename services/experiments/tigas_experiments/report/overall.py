"""Each controller over all networks, by round trip: the table that tells of an experiment as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tigas_experiments.report.metrics import TABLE, Metric
from tigas_experiments.report.results import Group, Results, Spread
from tigas_experiments.report.variants import Variant


@dataclass(frozen=True, slots=True, eq=False)
class Overall:
    """One controller at one round trip."""

    rtt_ms: float | None
    variant: Variant
    groups: tuple[Group, ...]
    """One a network."""

    @property
    def runs(self) -> int:
        """Of all networks."""
        return sum(len(group.runs) for group in self.groups)

    @property
    def name(self) -> str:
        """The controller's, marked if the machine was the bottleneck in a run."""
        return self.variant.title + "*" * any(group.saturated for group in self.groups)

    def spread(self, metric: Metric) -> Spread | None:
        """Of the networks' means, each of which counts the same."""
        spreads = [group.spread(metric) for group in self.groups]
        return Spread.over([None if spread is None else spread.mean for spread in spreads])


def overall(results: Results) -> list[Overall]:
    """By round trip and variant; of round trips that all networks have, so that their figures can be compared."""
    rtts = [rtt for rtt in _rtts(results) if all(results.at(network, rtt) for network in results.networks)]
    found = []
    for rtt in rtts:
        groups = [group for network in results.networks for group in results.at(network, rtt)]
        for variant in results.variants:
            of_variant = tuple(group for group in groups if group.variant == variant)
            if len(of_variant) == len(results.networks):
                found.append(Overall(rtt, variant, of_variant))
    return found


def markdown(rows: Sequence[Overall]) -> str:
    """As a table of Markdown, means alone."""
    if not rows:
        return "No controller was measured over all networks at one round trip.\n"
    lines = [
        "| round trip, ms | controller | runs | " + " | ".join(metric.heading for metric in TABLE) + " |",
        "|---:|---|---:|" + "---:|" * len(TABLE),
    ]
    for row in rows:
        means = [metric.text(spread.mean if (spread := row.spread(metric)) else None) for metric in TABLE]
        lines.append(f"| {rtt_text(row.rtt_ms)} | {_escaped(row.name)} | {row.runs} | {' | '.join(means)} |")
    return "\n".join(lines) + "\n"


def rtt_text(rtt_ms: float | None) -> str:
    """As it stands in a table."""
    return "its own" if rtt_ms is None else f"{rtt_ms:g}"


def _rtts(results: Results) -> list[float | None]:
    found = {group.condition.rtt_ms for group in results.groups}
    return sorted(found, key=lambda rtt: -1.0 if rtt is None else rtt)


def _escaped(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
