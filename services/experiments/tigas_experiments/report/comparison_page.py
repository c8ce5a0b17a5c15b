"""The page of a comparison: run by run, with what was on the screen beside what the viewer should have seen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tigas_common.wire.model import WireModel
from tigas_experiments.records.summary import Summary
from tigas_experiments.report.blocks import LEAST_BLOCKS, signed
from tigas_experiments.report.comparison_figures import figures, write_headline
from tigas_experiments.report.comparison_table import (
    COLUMNS,
    by_network,
    cells,
    column_groups,
    label,
    markdown,
    runs_as_made,
    titles,
)
from tigas_experiments.report.groups import Group, Groups
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.rate_distortion import QUALITIES, RateDistortion
from tigas_experiments.report.rate_distortion_figure import rate_distortion
from tigas_experiments.report.results import Results, Told
from tigas_experiments.report.snapshots import Snapshot, snapshots
from tigas_experiments.report.warnings import unreadable


class ComparisonData(WireModel):
    """report.json."""

    title: str
    command: str | None
    """What was run, to run it again."""
    runs: tuple[Summary, ...]
    """In the order in which they were made."""
    unreadable: tuple[str, ...]
    """What became of runs that cannot even be told of: a sentence each."""


@dataclass(frozen=True, slots=True)
class Section:
    """The runs over one network."""

    network: str
    runs: list[Summary]
    plots: list[Plot]
    distortion: RateDistortion | None
    snapshots: list[Snapshot]


def comparison_page(results: Results, groups: Groups, out: Path, told: Told) -> dict[str, object]:
    """What its template is filled with; writes report.json, table.md, headline.svg and headline.png, too.

    Raises OSError.
    """
    made = runs_as_made(results)
    experiment = results.experiment
    data = ComparisonData(
        title=results.title,
        command=None if experiment is None else experiment.command,
        runs=tuple(made),
        unreadable=tuple(unreadable(results)),
    )
    (out / "report.json").write_text(data.model_dump_json(indent=2) + "\n", encoding="utf-8")
    (out / "table.md").write_text(markdown(made), encoding="utf-8")
    networks = by_network(made)
    plots: dict[str, list[Plot]] = {}
    if results.runs:
        write_headline(results, out)
    for network, drawn in figures(results):
        plots[network] = drawn
        told("draws networks", len(plots), len(networks))
    distortions = _distortions(groups)
    for network, found in distortions.items():
        plot = rate_distortion(found, groups.looks, network)
        plots[network] += [plot] if plot is not None else []
    return {
        "runs": made,
        "sections": [
            Section(network, runs, plots.get(network, []), distortions.get(network), snapshots(results.folder, runs))
            for network, runs in networks.items()
        ],
        "columns": COLUMNS,
        "column_groups": column_groups(),
        "label": label,
        "titles": titles,
        "cells": cells,
        "qualities": QUALITIES,
        "signed": signed,
        "least_blocks": LEAST_BLOCKS,
    }


def _distortions(groups: Groups) -> dict[str, RateDistortion]:
    """By the network's label."""
    by_label: dict[str, list[Group]] = {}
    for group in groups:
        by_label.setdefault(group.runs[0].record.configuration.network.label, []).append(group)
    found = {
        label: RateDistortion.of(own, own[0].condition.network, own[0].condition.rtt_ms)
        for label, own in by_label.items()
    }
    return {label: one for label, one in found.items() if one is not None}
