"""The page of a comparison: run by run, with what was on the screen beside what the viewer should have seen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tigas_common.wire.model import WireModel
from tigas_experiments.records.summary import Summary
from tigas_experiments.report.comparison_figures import figures, write_headline
from tigas_experiments.report.comparison_table import (
    COLUMNS,
    by_network,
    cells,
    column_groups,
    label,
    markdown,
    runs_as_made,
)
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.plot import Plot
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
    snapshots: list[Snapshot]


def comparison_page(results: Results, _: Groups, out: Path, told: Told) -> dict[str, object]:
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
    return {
        "runs": made,
        "sections": [
            Section(network, runs, plots.get(network, []), snapshots(results.folder, runs))
            for network, runs in networks.items()
        ],
        "columns": COLUMNS,
        "column_groups": column_groups(),
        "label": label,
        "cells": cells,
    }
