"""The page of an experiment: claims, figures, and tables over groups of runs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from tigas_experiments.report.claims import claims
from tigas_experiments.report.experiment_figures import OF_A_NETWORK, overview
from tigas_experiments.report.groups import Groups, Spread, overall
from tigas_experiments.report.metrics import TABLE, Metric
from tigas_experiments.report.page import Page
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.results import Results, Told
from tigas_experiments.report.tables import overall_markdown, rtt_text
from tigas_experiments.report.warnings import experiment_warnings

MOST_NETWORKS = 8
"""So many are drawn one by one; the table and the CSV files have all."""


def experiment_page(results: Results, groups: Groups, out: Path, told: Told) -> Page:
    """Writes overall.md and the figures as SVG, too. Raises OSError."""
    totals = overall(groups)
    (out / "overall.md").write_text(overall_markdown(totals), encoding="utf-8")
    for old in out.glob("[0-9][0-9]-*_*.svg"):  # of a report that had other networks
        old.unlink()
    plots: dict[str | None, list[Plot]] = {}
    for count, (network, plot) in enumerate(_figures(groups), 1):
        (out / f"{plot.name}.svg").write_text(plot.svg, encoding="utf-8")
        plots.setdefault(network, []).append(plot)
        told("draws figures", count, None)
    return Page(
        "experiment",
        experiment_warnings(results),
        {
            "claims": claims(groups),
            "groups": groups,
            "overview": plots.pop(None, []),
            "by_network": plots,
            "totals": totals if len(groups.networks) > 1 else [],
            "table": TABLE,
            "cell": cell,
            "rtt_text": rtt_text,
        },
    )


def cell(spread: Spread | None, metric: Metric) -> tuple[str, str | None]:
    """The mean; from the least to the greatest, where they differ."""
    if spread is None:
        return metric.text(None), None
    low, high = metric.text(spread.low), metric.text(spread.high)
    return metric.text(spread.mean), None if low == high else f"{low}–{high}"


def _figures(groups: Groups) -> Iterator[tuple[str | None, Plot]]:
    """Each with the network that it is of."""
    if (plot := overview(groups)) is not None:
        yield None, plot
    for number, network in enumerate(groups.networks[:MOST_NETWORKS], 1):
        slug = f"{number:02}-" + (re.sub(r"[^A-Za-z0-9.-]+", "-", network).strip(".-")[:40] or "network")
        for draw in OF_A_NETWORK:
            if (plot := draw(groups, network)) is not None:
                yield network, replace(plot, name=f"{slug}_{plot.name}")
