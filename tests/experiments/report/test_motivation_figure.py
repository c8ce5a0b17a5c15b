"""The motivating figure: which runs it is of, and what it says of downloads."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from tests.experiments.report.made_up_results import download, write_run
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.metrics import FIRST_PICTURE, WHOLE_SCENE
from tigas_experiments.report.motivation_figure import motivation
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.results import load


def drawn(folder: Path, *runs: dict[str, Any]) -> Plot | None:
    """The figure of runs of two seconds."""
    for number, run in enumerate(runs):
        write_run(folder / "runs" / f"{number:02}", **run)
    return motivation(Groups.of(load(folder).runs))


@pytest.mark.parametrize(
    ("first_s", "complete_s", "words"),
    [
        (0.5, 1.5, "2.0 MB, all of the scene on the screen after 1.5 s"),
        (0.5, None, "2.0 MB of 2.0, the first picture after 0.5 s"),
        (None, None, "2.0 MB of 2.0, and no picture"),
    ],
)
def test_a_download_is_held_against_pictures_of_the_same_walk(
    tmp_path: Path, first_s: float | None, complete_s: float | None, words: str
) -> None:
    local = {"mode": "local-ply", "local": download(first_s, complete_s), "kbps": 8000.0}
    plot = drawn(tmp_path, {"controller": "budget", "kbps": 4000.0}, local)
    assert plot is not None
    assert plot.title == f"Received: Stateless, budget 1.0 MB; Local, PLY {words}"
    assert "courtyard, stroll, over bus,20ms-rtt" in plot.caption
    assert "Link's rate" in plot.svg


def test_it_is_of_the_walk_that_most_modes_made(tmp_path: Path) -> None:
    local = {"mode": "local-ply", "local": download(0.5, 1.5)}
    many = {"movement": "orbit"}
    plot = drawn(
        tmp_path,
        {"controller": "budget"},
        local,
        *({**run, **many} for run in ({"controller": "budget"}, {"controller": "latency"}, local)),
    )
    assert plot is not None
    assert "courtyard, orbit" in plot.caption


def test_a_download_s_times_are_figures_of_its_runs_and_of_no_others(tmp_path: Path) -> None:
    local = {"mode": "local-ply", "local": download(0.5, None)}
    drawn(tmp_path, {"controller": "budget"}, local)
    of_pictures, of_download = Groups.of(load(tmp_path).runs)
    assert of_pictures.spread(FIRST_PICTURE) is None
    assert [of_download.blocks(metric).popitem()[1] for metric in (FIRST_PICTURE, WHOLE_SCENE)] == [0.5, math.inf]


def test_runs_of_one_kind_have_no_such_figure(tmp_path: Path) -> None:
    assert drawn(tmp_path, {"controller": "budget"}, {"mode": "dash-edge"}) is None
    local = {"mode": "local-ply", "local": download(0.5, 1.5)}
    assert drawn(tmp_path / "local", local, {**local, "mode": "local-compressed"}) is None
