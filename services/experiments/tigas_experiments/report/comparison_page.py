"""The page of a comparison: run by run, with what was on the screen beside what the viewer should have seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tigas_common.wire.model import WireModel
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.summary import Summary
from tigas_experiments.report.comparison_figures import Curve, figures, write_headline
from tigas_experiments.report.comparison_table import (
    COLUMNS,
    by_network,
    cells,
    column_groups,
    label,
    markdown,
    runs_as_made,
)
from tigas_experiments.report.controllers import looks
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.page import Page
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.results import Results, Told
from tigas_experiments.report.snapshots import Snapshot, snapshot
from tigas_experiments.report.warnings import comparison_warnings


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


def comparison_page(results: Results, _: Groups, out: Path, told: Told) -> Page:
    """Writes report.json, table.md, headline.svg and headline.png, too. Raises OSError."""
    made = runs_as_made(results)
    experiment = results.experiment
    data = ComparisonData(
        title=results.title,
        command=None if experiment is None else experiment.command,
        runs=tuple(made),
        unreadable=tuple(
            f"{failure.folder}: there is no result. {failure.reason}"
            for failure in results.failures
            if failure.record is None
        ),
    )
    (out / "report.json").write_text(data.model_dump_json(indent=2) + "\n", encoding="utf-8")
    (out / "table.md").write_text(markdown(made), encoding="utf-8")
    networks = by_network(made)
    curves = {network: _curves(results, runs) for network, runs in networks.items()}
    if any(curves.values()):
        write_headline({network: own for network, own in curves.items() if own}, out)
    sections = []
    for done, (network, runs) in enumerate(networks.items(), 1):
        plots = figures(curves[network]) if curves[network] else []
        sections.append(Section(network, runs, plots, list(_snapshots(results.folder, runs))))
        told("draws networks", done, len(networks))
    return Page(
        "comparison",
        comparison_warnings(data.runs, data.unreadable),
        {
            "runs": made,
            "sections": sections,
            "columns": COLUMNS,
            "column_groups": column_groups(),
            "label": label,
            "cells": cells,
        },
    )


def _curves(results: Results, runs: Sequence[Summary]) -> list[Curve]:
    """Of the complete ones."""
    complete = {run.folder: run for run in results.runs}
    look = looks(run.controller for run in results.runs)
    own = [complete[run.folder] for run in runs if run.folder in complete]
    return [Curve(run, label(run.record), look[run.controller]) for run in own]


def _snapshots(folder: Path, runs: Sequence[Summary]) -> Iterator[Snapshot]:
    """Of the complete runs that kept one."""
    for run in runs:
        if run.figures is not None:
            with suppress(BrokenRecording):  # its figures stay
                if (found := snapshot(StoredRun(folder / "runs" / run.folder), label(run.record))) is not None:
                    yield found
